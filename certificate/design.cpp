#include "certificate/design.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <numbers>
#include <utility>

#include "certificate/feasibility.h"
#include "certificate/linear_loop.h"
#include "certificate/postures.h"
#include "certificate/stability_certificate.h"
#include "controller/registry.h"
#include "diagnostics/failure.h"
#include "process/parallel.h"
#include "robot/decompositions.h"
#include "robot/dynamics.h"
#include "robot/model.h"

namespace tachless::certificate {
namespace {

using controller::law::Tuning;
using diagnostics::ExitCode;
using diagnostics::Failure;
using loop::ReferencePoint;
using process::parallel_map;
using robot::Vector;

constexpr double pi = std::numbers::pi;
constexpr int other_postures = 16;
constexpr double default_bandwidth_by_rate = 0.005;  // w / 2 pi over 1 / h
// The filter is never faster than 1 / h, which the last ratio stands for.
constexpr std::array filter_ratios = {4.0, 10.0, 1e9};
constexpr std::array dampings = {1.0, 1.5, 2.0, 3.0};
constexpr double least_gain_margin = 1.5;
constexpr double between_frequencies = 1.02;  // the modulus may be that much lower than at them
constexpr double as_fast = 1.1;  // of the shortest settling time: rules within it count as equal
constexpr const char* bandwidth_asked_for = "the bandwidth asked for";

/// One of the rules that are tried: all but w and what follows from it.
struct Rule {
  Tuning tuning;
  double filter_ratio = 0;  ///< filter / (damping w)
};

/// The geometric mean over the postures of m_j = 1 / (M^-1)_jj.
Vector mean_inertia(const std::vector<Eigen::MatrixXd>& inverse_M) {
  Vector sum = Vector::Zero(inverse_M.front().rows());
  for (const auto& inverse : inverse_M) sum.array() -= inverse.diagonal().array().log();
  return (sum / static_cast<double>(inverse_M.size())).array().exp();
}

/// Joint inertias D from `start` on, such that the eigenvalues of M^-1 D at all postures together
/// are as near each other as they can be: the loop's directions are as fast and as damped as these.
Vector balanced_inertia(const std::vector<Eigen::MatrixXd>& inverse_M, const Vector& start) {
  const auto spread = [&](const Eigen::VectorXd& log_scale) {
    const Vector root = (start.array().log() + log_scale.array()).exp().sqrt();
    double least = infinity, largest = 0;
    for (const auto& inverse : inverse_M) {
      const Eigen::MatrixXd scaled = root.asDiagonal() * inverse * root.asDiagonal();
      const Eigen::VectorXd mu = robot::symmetric_eigenvalues(scaled);
      least = std::min(least, mu.minCoeff());
      largest = std::max(largest, mu.maxCoeff());
    }
    return std::log(largest / least);
  };
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(start.size());
  const Eigen::VectorXd best = minimise(spread, none, 0.5, 1000).x;
  return start.array() * (best.array() - best.mean()).exp();
}

/// Within the joint's limits, where it has some.
Vector posture_in_range(const robot::Model& model, int k) {
  Vector q = spread_posture(model, k);
  for (int i = 0; i < model.num_joints; ++i) {
    const double width = model.upper[i] - model.lower[i];
    if (model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::revolute &&
        width < 2 * pi) {
      q[i] = model.lower[i] + (q[i] + pi) / (2 * pi) * width;
    }
  }
  return q;
}

/// How far the error at rest may reach: the geometric mean over the joints.
double size_of(const Region& region) { return std::exp(region.e_at_rest.array().log().mean()); }

class Search {
 public:
  Search(const experiment::Scenario& scenario, const DesignGoal& goal)
      : scenario_(scenario), goal_(goal), law_(controller::law_facts(scenario.controller.law)) {
    if (!law_.tuned) {
      throw Failure(ExitCode::check_said_no, "{} has no rule for its gains: tune it by hand",
                    law_.name);
    }
    const robot::Model model = plant_of(scenario);
    const robot::Model& links = scenario.robot.flexible ? *scenario.model : model;
    mean_.inertia = Vector::Ones(model.num_joints);
    if (const auto& drive = scenario.robot.flexible) {
      mean_.stiffness = drive->stiffness;
      mean_.rotor = drive->rotor_inertia;
    }
    rests_ = loop_of(1, plain_rule()).rest_points(reference_postures);
    num_reference_ = rests_.size();
    for (int k = 1; k <= other_postures; ++k)
      rests_.push_back(constant_reference(posture_in_range(model, k)));
    inverse_M_ = parallel_map(rests_.size(), [&](std::size_t i) -> Eigen::MatrixXd {
      return robot::inverse(robot::mass_matrix(links, rests_[i].q_ref));
    });
    mean_.inertia = mean_inertia(inverse_M_);
    mean_.period_s = scenario.loop.period_s;
  }

  /// With the mean inertias, critically damped, filters ten times as fast.
  [[nodiscard]] Rule plain_rule() const { return {mean_, 10}; }

  [[nodiscard]] std::vector<Rule> rules() const {
    const auto with_filter = [&](double pole) {
      Tuning tuning = mean_;
      tuning.filter = pole;
      return law_.tuned(tuning);
    };
    const double rate = 1 / scenario_.loop.period_s;
    const bool has_filter = with_filter(0.1 * rate) != with_filter(0.2 * rate);
    std::vector<Rule> all;
    for (const Vector& inertia : {mean_.inertia, balanced_inertia(inverse_M_, mean_.inertia)}) {
      for (const double damping : dampings) {
        for (const double ratio : filter_ratios) {
          if (!has_filter && ratio != filter_ratios[0]) continue;
          all.push_back({mean_, ratio});
          all.back().tuning.inertia = inertia;
          all.back().tuning.damping = damping;
        }
      }
    }
    return all;
  }

  [[nodiscard]] std::map<std::string, Vector> gains(double w, const Rule& rule) const {
    Tuning tuning = rule.tuning;
    tuning.w = w;
    tuning.filter = std::min(rule.filter_ratio * (tuning.damping * w), 1 / scenario_.loop.period_s);
    return law_.tuned(tuning);
  }

  /// The design with w up to `highest` of the largest certified region among those that settle
  /// first, and the rule that made it. Where nothing is certified, the first of them.
  std::pair<Design, Rule> best_up_to(double highest, const std::vector<Rule>& rules,
                                     const OnProgress& tell) {
    const std::vector<Candidate> candidates = candidates_up_to(highest, rules, tell);
    const Candidate* best = &candidates.front();
    std::optional<Region> largest;
    for (const Candidate& each : candidates) {
      tell("design: certified regions");
      const auto region = largest_region(scenario_with(each.w, each.rule));
      if (!region || (largest && size_of(*region) <= size_of(*largest))) continue;
      best = &each;
      largest = region;
    }
    Design design = result(*best);
    if (largest) design.certified_error = largest->e_at_rest;
    return {design, best->rule};
  }

 private:
  /// What a rule comes to.
  struct Candidate {
    Rule rule;
    double w = 0, settling_s = 0;
    std::string binds;
  };

  [[nodiscard]] experiment::Scenario scenario_with(double w, const Rule& rule) const {
    experiment::Scenario scenario = scenario_;
    scenario.controller.gains = gains(w, rule);
    return scenario;
  }
  [[nodiscard]] ScenarioLoop loop_of(double w, const Rule& rule) const {
    return ScenarioLoop(scenario_with(w, rule));
  }

  /// The settling time at the reference's slowest posture; infinite for an unstable loop.
  [[nodiscard]] double settling_s(double w, const Rule& rule) const {
    const ScenarioLoop loop = loop_of(w, rule);
    const std::vector<double> each = parallel_map(num_reference_, [&](std::size_t i) {
      return modes(loop.at(rests_[i]), loop.settings().period_s).settling_s;
    });
    return *std::max_element(each.begin(), each.end());
  }

  /// Why these gains do not do; empty when they do.
  [[nodiscard]] std::string objection(double w, const Rule& rule) {
    const ScenarioLoop loop = loop_of(w, rule);
    const double h = loop.settings().period_s;
    std::atomic<bool> any = false;
    const auto found = parallel_map(rests_.size(), [&](std::size_t i) {
      if (any) return "";
      const CutLoop here = cut(loop.at(rests_[i]), h);
      const auto stable = [&](double gain) { return spectral_radius(here.closed(gain)) < 1; };
      const char* why = "";
      if (!stable(1)) {
        why = "stability";
      } else if (!stable(least_gain_margin)) {
        why = "the gain margin";
      } else if (!has_modulus(here, h, between_frequencies * goal_.modulus)) {
        why = "the modulus margin";
      }
      if (*why != 0) any = true;
      return why;
    });
    for (std::size_t i = 0; i < found.size(); ++i) {
      if (*found[i] == 0) continue;
      std::string why =
          fmt::format("{} at q = [{:.2f}]", found[i], fmt::join(rests_[i].q_ref, ", "));
      std::swap(rests_[i], rests_[i < num_reference_ ? 0 : num_reference_]);  // first, next time
      return why;
    }
    const auto& limit = scenario_.plant.drive.torque_limit_Nm;
    if (!limit) return {};
    const Vector count = experiment::encoder_count(scenario_, *scenario_.model);
    const auto gain = own_gain(loop.at(rests_.front()).law(h));
    for (Eigen::Index i = 0; i < gain.size(); ++i) {
      if (gain[i] * count[i] > goal_.count_share * (*limit)[i]) {
        return fmt::format(
            "the torque of one encoder count on {}",
            robot::joint_labels(*scenario_.model).joint(static_cast<std::size_t>(i)));
      }
    }
    return {};
  }

  /// The largest w up to `highest` without objection, to 5 %; 0 when there is none that settles
  /// within `useful_s`. `why` is what binds.
  double largest_w(double highest, const Rule& rule, double useful_s, std::string& why) {
    double good = 0, bad = 0;
    const auto attempt = [&](double w) {
      const std::string still = objection(w, rule);
      (still.empty() ? good : bad) = w;
      if (!still.empty()) why = still;
    };
    for (double w = highest; w > 1e-3 * highest && good == 0; w /= 1.5) {
      const double settling = settling_s(w, rule);
      if (std::isfinite(settling) && settling > useful_s) return 0;
      attempt(w);
    }
    while (good > 0 && bad > 1.05 * good) attempt(std::sqrt(good * bad));
    return good;
  }

  /// Of each rule with w up to `highest`; those as fast as the fastest.
  std::vector<Candidate> candidates_up_to(double highest, const std::vector<Rule>& rules,
                                          const OnProgress& tell) {
    double fastest = infinity;
    std::string last_reason;
    std::vector<Candidate> all;
    for (std::size_t k = 0; k < rules.size(); ++k) {
      tell(fmt::format("design: rule {} of {}", k + 1, rules.size()));
      std::string why;
      const double w = largest_w(highest, rules[k], as_fast * fastest, why);
      if (!why.empty()) last_reason = why;
      if (w == 0) continue;
      const double settling = settling_s(w, rules[k]);
      fastest = std::min(fastest, settling);
      all.push_back({rules[k], w, settling, why.empty() ? bandwidth_asked_for : why});
    }
    if (all.empty()) {
      throw Failure(
          ExitCode::check_said_no,
          "no bandwidth up to {:.3g} Hz meets the requirements (limited by {}); allow a shorter "
          "period, less delay, a finer encoder or a smaller --margin",
          highest / (2 * pi), last_reason);
    }
    std::erase_if(all, [&](const Candidate& c) { return c.settling_s > as_fast * fastest; });
    return all;
  }

  /// All of it, but for what is certified.
  [[nodiscard]] Design result(const Candidate& candidate) const {
    const experiment::Scenario scenario = scenario_with(candidate.w, candidate.rule);
    const ScenarioLoop loop(scenario);
    const std::size_t others = rests_.size() - num_reference_;
    const std::vector<double> modulus = parallel_map(others, [&](std::size_t i) {
      return margins(loop.at(rests_[num_reference_ + i]), loop.settings().period_s).modulus;
    });
    Design design;
    design.gains = scenario.controller.gains;
    design.w = candidate.w;
    design.damping = candidate.rule.tuning.damping;
    for (const auto& [name, value] : design.gains) {
      if (name == "a" || name == "a1") design.filter_ratio = value[0] / candidate.w;
    }
    design.binds = candidate.binds;
    design.loop = analyse(scenario, Effort::full);
    design.modulus_in_range = *std::ranges::min_element(modulus);
    design.postures_in_range = static_cast<int>(others);
    return design;
  }

  const experiment::Scenario& scenario_;
  DesignGoal goal_;
  const controller::LawFacts& law_;
  std::vector<Eigen::MatrixXd> inverse_M_;  ///< at each of `rests_` to begin with, of the links
  Tuning mean_;                             ///< with the mean inertias
  std::vector<ReferencePoint> rests_;
  std::size_t num_reference_ = 0;
};

}  // namespace

Design design(const experiment::Scenario& scenario, const DesignGoal& goal,
              const OnProgress& tell) {
  const Feasibility feasible = feasibility(scenario);
  if (!feasible.impossible.empty()) {
    throw Failure(ExitCode::check_said_no, feasible.impossible.front());
  }
  const controller::LawFacts& law = controller::law_facts(scenario.controller.law);
  if (!law.no_linearisation.empty()) {
    throw Failure(ExitCode::check_said_no,
                  "{} cannot be linearised ({}): tune it by hand, or by the rule of thumb of "
                  "tachless sweep --laws",
                  law.name, law.no_linearisation);
  }
  Search search(scenario, goal);
  const double rate = 1 / scenario.loop.period_s;
  if (!goal.settling_s) {
    const double hz = goal.bandwidth_hz.value_or(default_bandwidth_by_rate * rate);
    return search.best_up_to(2 * pi * hz, search.rules(), tell).first;
  }
  // Settling scales with 1 / w: from the estimate of two real poles, corrected until it is met.
  const double wanted = *goal.settling_s;
  double highest = 7 / wanted;
  auto [best, rule] = search.best_up_to(highest, search.rules(), tell);
  for (int i = 0; i < 4 && best.binds == bandwidth_asked_for; ++i) {
    const double settling_s = best.loop.modes.settling_s;
    if (std::abs(settling_s - wanted) < 0.03 * wanted) break;
    highest *= settling_s / wanted;
    best = search.best_up_to(highest, {rule}, tell).first;
  }
  if (best.loop.modes.settling_s > 1.05 * wanted) best.missed = wanted;
  return best;
}

std::vector<std::string> rule_of_thumb(const experiment::Scenario& scenario, const std::string& law,
                                       double hz, double filter_ratio) {
  experiment::Scenario own = scenario;
  own.controller.law = law;
  const Search search(own, {});
  Design design;
  Rule rule = search.plain_rule();
  rule.filter_ratio = filter_ratio;
  design.gains = search.gains(2 * pi * hz, rule);
  std::vector<std::string> all = overrides_of(design);
  all.insert(all.begin(), "controller.law=" + law);
  return all;
}

std::vector<std::string> overrides_of(const Design& design) {
  std::vector<std::string> all;
  for (const auto& [name, value] : design.gains) {
    all.push_back(fmt::format("controller.gains.{}=[{:.4g}]", name,
                              fmt::join(value.begin(), value.end(), ", ")));
  }
  return all;
}

}  // namespace tachless::certificate
