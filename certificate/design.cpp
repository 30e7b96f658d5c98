#include "certificate/design.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "certificate/design_problem.h"
#include "certificate/feasibility.h"
#include "certificate/gain_search.h"
#include "certificate/linear_loop.h"
#include "certificate/postures.h"
#include "certificate/stability_certificate.h"
#include "controller/registry.h"
#include "diagnostics/failure.h"
#include "process/parallel.h"
#include "robot/model.h"

namespace tachless::certificate {
namespace {

using diagnostics::ExitCode;
using diagnostics::Failure;
using Eigen::Index;
using Eigen::VectorXd;
using loop::ReferencePoint;
using process::parallel_map;
using robot::Vector;

constexpr int more_postures = 200, worst_postures = 6;
constexpr int searched_postures = 4, search_evaluations = 50, rounds = 5;
constexpr int steps_of_a_start = 20, steps_of_a_round = 60;
constexpr double margin_tolerance = 0.002;  // numbers are printed with two digits

class Search {
 public:
  Search(const experiment::Scenario& scenario, const DesignGoal& goal)
      : scenario_(scenario),
        goal_(goal),
        law_(scenario, goal),
        labels_(robot::joint_labels(*scenario.model)),
        rests_(law_.first_rests()) {
    law_.choose_variables();
    problem_ = law_.at(rests_);
  }

  Design found(const OnProgress& tell) {
    best_.theta = best_start(tell);
    for (int round = 0; round < rounds; ++round) {
      const std::string what = fmt::format("design: round {} of at most {}", round + 1, rounds);
      search(what, tell);
      tell(what + ", other postures");
      if (!add_worst(round)) break;
    }
    for (int attempt = 0; attempt < 3; ++attempt) {
      Design design = result(tell);
      if (!design.loop.stable || !design.loop.margins) break;
      if (design.loop.margins->modulus >= goal_.modulus - margin_tolerance) return design;
      rests_.push_back(constant_reference(design.loop.margin_q));
      const double between = goal_.modulus - design.loop.margins->modulus;  // its frequencies
      const double margin = problem_.margin + between;
      problem_ = law_.at(rests_);
      problem_.margin = margin;
      search("design: a posture of the reference more", tell);
    }
    refuse();
  }

 private:
  [[noreturn]] void refuse() const {
    throw Failure(ExitCode::check_said_no,
                  "no gains were found that keep a modulus margin of {:g} at all postures within "
                  "the torque of an encoder count; allow a shorter period, less delay, a finer "
                  "encoder or a smaller --margin",
                  goal_.modulus);
  }

  // ---- search -----------------------------------------------------------------------------------

  void search(const std::string& what, const OnProgress& tell) {
    best_ =
        faster_gains(problem_, best_.theta, steps_of_a_round, [&](int step, const FoundGains& now) {
          tell(fmt::format("{}, step {}: settles in {}, modulus {:.3f}", what, step,
                           settling_text(now.settling_s), now.modulus));
        });
    if (!std::isfinite(best_.settling_s)) refuse();
  }

  /// The best of some starts after some steps each: by the rule, at the largest w that has half the
  /// margin and at a quarter of it; where these come to nothing, at the largest that has it all. Of
  /// a rule that has less, the w with the most.
  VectorXd best_start(const OnProgress& tell) {
    struct Start {
      double filter_ratio, damping, part_of_margin, slower;
    };
    constexpr std::array starts = {Start{4, 1, 0.5, 1},   Start{20, 1, 0.5, 1},
                                   Start{4, 1, 0.5, 4},   Start{20, 1, 0.5, 4},
                                   Start{20, 1, 1.02, 1}, Start{1e9, 3, 1.02, 1}};
    FoundGains best;
    for (const Start& start : starts) {
      if (start.part_of_margin > 1 && std::isfinite(best.settling_s)) break;
      tell(
          fmt::format("design: start {} of at most {}", &start - starts.data() + 1, starts.size()));
      const auto gains_at = [&](double w) -> VectorXd {
        return law_.theta_of(law_.by_rule(w, start.filter_ratio, start.damping))
            .cwiseMax(problem_.lower)
            .cwiseMin(problem_.upper);
      };
      const double rate = 1 / scenario_.loop.period_s;
      double best_w = 0, modulus = 0;
      for (double w = 0.2 * rate; w > 1e-5 * rate; w /= 1.5) {
        const double here = judged(problem_, gains_at(w)).modulus;
        if (here > modulus) {
          modulus = here;
          best_w = w;
        }
        if (modulus > start.part_of_margin * goal_.modulus) break;
      }
      if (best_w == 0) continue;
      const bool all = modulus > start.part_of_margin * goal_.modulus;
      const FoundGains found =
          faster_gains(problem_, gains_at(best_w / (all ? start.slower : 1)),
                       all ? steps_of_a_start : steps_of_a_round, [](int, const FoundGains&) {});
      if (found.settling_s < best.settling_s) best = found;
    }
    if (!std::isfinite(best.settling_s)) refuse();
    return best.theta;
  }

  /// The least modulus at a posture; above 1 beyond the joints' ranges.
  [[nodiscard]] double modulus_at(const Vector& q) const {
    for (int i = 0; i < law_.model().num_joints; ++i) {
      if (q[i] < law_.model().lower[i] || q[i] > law_.model().upper[i]) return 2;
    }
    return least_moduli(law_.at({constant_reference(q)}), best_.theta)[0];
  }

  /// Adds the worst of other postures, the first of them searched from there; whether there was one
  /// without the margin.
  bool add_worst(int round) {
    std::vector<ReferencePoint> at;
    for (int k = 1; k <= more_postures; ++k) {
      at.push_back(rest_in_range(law_.model(), 1000 + round * more_postures + k));
    }
    const std::vector<double> modulus = least_moduli(law_.at(at), best_.theta);
    std::vector<std::pair<double, std::size_t>> order;
    for (std::size_t i = 0; i < modulus.size(); ++i) order.emplace_back(modulus[i], i);
    std::ranges::sort(order);
    const auto searched = parallel_map(searched_postures, [&](std::size_t k) {
      return minimise([&](const VectorXd& q) { return modulus_at(q); }, at[order[k].second].q_ref,
                      0.3, search_evaluations);
    });
    worst_ = *std::ranges::min_element(searched, {}, &Minimum::value);
    for (const Minimum& each : searched) {
      if (each.value < problem_.margin) rests_.push_back(constant_reference(each.x));
    }
    for (std::size_t k = 0; k < worst_postures && order[k].first < problem_.margin; ++k) {
      rests_.push_back(at[order[k].second]);
    }
    problem_ = law_.at(rests_);
    return worst_.value < problem_.margin;
  }

  // ---- result -----------------------------------------------------------------------------------

  [[nodiscard]] std::string words(const Binding& binding) const {
    const double percent = 100 * binding.settling_share;
    const std::string much =
        fmt::format(": a tenth more gives {} %",
                    percent < 10 ? fmt::format("{:.1g}", percent) : fmt::format("{:.0f}", percent));
    switch (binding.kind) {
      case Binding::Kind::margin:
        return fmt::format("the modulus margin at q = {}{}", list_text(rests_[binding.which].q_ref),
                           much);
      case Binding::Kind::count:
        return fmt::format("the torque of one encoder count on {}{}", labels_.joint(binding.which),
                           much);
      case Binding::Kind::bound:
        break;
    }
    return fmt::format("the bound on {}{}", law_.name_of(binding.which), much);
  }

  [[nodiscard]] Design result(const OnProgress& tell) const {
    Design design;
    design.gains = law_.gains(best_.theta);
    for (auto& [name, values] : design.gains) {
      for (double& value : values) value = std::stod(fmt::format("{:.4g}", value));
    }
    for (const Binding& each : bindings(problem_, best_)) design.binds.push_back(words(each));
    const experiment::Scenario scenario = law_.with(design.gains);
    design.loop = analyse(scenario, Effort::full, tell);
    design.modulus_in_range = worst_.value;
    design.range_q = worst_.x;
    design.postures_in_range = more_postures;
    tell("design: certified region");
    if (const auto region = largest_region(scenario)) design.certified_error = region->e_at_rest;
    add_friction(design);
    return design;
  }

  void add_friction(Design& design) const {
    const auto n = static_cast<Index>(law_.model().num_joints);
    design.stiffness = design.loop.stiffness;
    design.stuck_error = design.loop.rest_error;
    const Vector &coulomb = scenario_.plant.drive.coulomb_friction_Nm,
                 &viscous = scenario_.plant.drive.viscous_friction_Nms_per_rad;
    const std::vector<ReferencePoint> on_the_way = law_.loop().rest_points(reference_postures);
    for (Index j = 0; j < n; ++j) {
      const std::string name = labels_.joint(static_cast<std::size_t>(j));
      const auto [least, most] =
          std::ranges::minmax(on_the_way, {}, [j](const ReferencePoint& r) { return r.q_ref[j]; });
      const double motion = most.q_ref[j] - least.q_ref[j];
      if (design.stuck_error.size() > 0 && design.stuck_error[j] > 0.01 * motion) {
        design.warnings.push_back(fmt::format(
            "{} stops up to {:.2g} {} beside its goal: Coulomb friction of {:g} {} over a "
            "stiffness "
            "of {:.3g}; its motion is {:.2g}",
            name, design.stuck_error[j], labels_.length[static_cast<std::size_t>(j)], coulomb[j],
            labels_.effort[static_cast<std::size_t>(j)], design.stiffness[j], motion));
      }
      const double w = std::sqrt(design.stiffness[j] / law_.mean_inertia()[j]);
      if (viscous.size() > 0 && 3 * design.stiffness[j] < w * viscous[j]) {
        design.warnings.push_back(
            fmt::format("{} is slowed by its viscous friction of {:g}: a pole at {:.2g} 1/s", name,
                        viscous[j], design.stiffness[j] / viscous[j]));
      }
    }
  }

  const experiment::Scenario& scenario_;
  DesignGoal goal_;
  DesignProblem law_;
  robot::JointLabels labels_;
  std::vector<ReferencePoint> rests_;
  GainProblem problem_;  ///< at these
  FoundGains best_;
  Minimum worst_;  ///< of the modulus over the joints' range
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
  if (scenario.robot.flexible && !law.needs_flexible_joints) {
    throw Failure(ExitCode::check_said_no,
                  "{} is a law for rigid joints and {} has flexible ones: take "
                  "--set controller.law=loria_ortega_flexible, or kelly_flexible to hold a posture",
                  law.name, scenario.robot.name);
  }
  Design best = Search(scenario, goal).found(tell);
  if (goal.settling_s && best.loop.modes.settling_s > 1.05 * *goal.settling_s) {
    best.missed = goal.settling_s;
  }
  return best;
}

std::vector<std::string> rule_of_thumb(const experiment::Scenario& scenario, const std::string& law,
                                       double hz, double filter_ratio) {
  experiment::Scenario own = scenario;
  own.controller.law = law;
  Design design;
  design.gains = DesignProblem(own, {}).by_rule(2 * std::numbers::pi * hz, filter_ratio, 1, false);
  std::vector<std::string> all = overrides_of(design);
  all.insert(all.begin(), {"controller.gains={}", "controller.law=" + law});
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
