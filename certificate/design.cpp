#include "certificate/design.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "certificate/certify.h"
#include "certificate/parallel.h"
#include "certificate/postures.h"
#include "controller/registry.h"
#include "diagnostics/failure.h"
#include "robot/mass_matrix.h"

namespace tachless::certificate {
namespace {

using diagnostics::ExitCode;
using diagnostics::Failure;
using loop::ReferencePoint;
using robot::Vector;

constexpr double pi = std::numbers::pi;
constexpr int reference_postures = 5, other_postures = 16;
constexpr double default_bandwidth_by_rate = 0.005;  // w / 2 pi over 1 / h
constexpr std::array filter_ratios = {4.0, 6.0, 10.0, 16.0};

/// What the rule of thumb needs of a robot.
struct Inertias {
  Vector link;  ///< geometric mean over the postures of 1 / (M^-1)_jj [kg m2]
  Vector stiffness, rotor;
};

Inertias inertias_of(const experiment::Scenario& scenario, const robot::Model& model,
                     const std::vector<ReferencePoint>& rests) {
  Inertias result;
  result.link = Vector::Zero(model.num_joints);
  for (const ReferencePoint& rest : rests) {
    const Eigen::MatrixXd M = robot::mass_matrix(model, rest.q_ref);
    const Eigen::MatrixXd inverse = M.inverse();
    result.link.array() -= inverse.diagonal().array().log();
  }
  result.link = (result.link / static_cast<double>(rests.size())).array().exp();
  if (scenario.robot.flexible) {
    result.stiffness = scenario.robot.flexible->stiffness;
    result.rotor = scenario.robot.flexible->rotor_inertia;
  }
  return result;
}

/// The rule of thumb, for each parameter that a law of the catalogue is tuned by. A motor behind a
/// spring has its resonance sqrt(K / J) damped by a quarter of critical.
std::optional<Vector> rule(const std::string& law, std::string_view gain, double w, double ratio,
                           const Inertias& inertia) {
  const Vector& m = inertia.link;
  const Vector one = Vector::Ones(m.size());
  const bool on_motor = law == "kelly_flexible";
  const Vector felt = on_motor ? Vector(m + inertia.rotor) : m;
  if (gain == "kp" || gain == "kp1") return w * w * felt;
  if (gain == "kd" || gain == "kd1") return 2 * w * felt;
  if (gain == "a" || gain == "b" || gain == "a1" || gain == "b1") return ratio * w * one;
  if (gain == "lambda") return w * one;
  if (gain == "ks" || gain == "ks1") return w * m;
  if (inertia.rotor.size() == 0) return {};
  const Vector resonance = inertia.stiffness.cwiseQuotient(inertia.rotor).cwiseSqrt();
  const Vector damping = 0.5 * inertia.rotor.cwiseProduct(resonance);
  if (gain == "kp2") return 0.01 * inertia.stiffness;
  if (gain == "kd2" || gain == "ks2") return damping;
  if (gain == "a2" || gain == "b2") return 3 * resonance;
  return {};
}

class Search {
 public:
  Search(const experiment::Scenario& scenario, const DesignGoal& goal)
      : scenario_(scenario), goal_(goal) {
    for (const auto& parameter : controller::law_facts(scenario.controller.law).parameters) {
      names_.emplace_back(parameter.name);
    }
    const robot::Model model = plant_of(scenario);
    experiment::Scenario start = scenario;
    const robot::Model& links = scenario.robot.flexible ? *scenario.model : model;
    ReferencePoint first = held_at(reference::make_trajectory(scenario).at(0).q_ref);
    inertia_ = inertias_of(scenario, links, {first});
    start.controller.gains = gains(1, 10);
    rests_ = ScenarioLoop(start).rests(reference_postures);
    num_reference_ = rests_.size();
    for (int k = 1; k <= other_postures; ++k) rests_.push_back(held_at(spread_posture(model, k)));
    inertia_ = inertias_of(scenario, links, rests_);
  }

  [[nodiscard]] std::map<std::string, Vector> gains(double w, double ratio) const {
    std::map<std::string, Vector> all;
    for (const std::string& name : names_) {
      auto value = rule(scenario_.controller.law, name, w, ratio, inertia_);
      if (!value) {
        throw Failure(ExitCode::check_said_no,
                      fmt::format("no rule for the gain {} of {}: design it by hand", name,
                                  scenario_.controller.law));
      }
      all[name] = std::move(*value);
    }
    return all;
  }

  [[nodiscard]] bool has_filter() const {
    return std::any_of(names_.begin(), names_.end(),
                       [](const std::string& name) { return name == "a" || name == "a1"; });
  }

  /// Why these gains do not do; empty when they do. Necessary for the modulus margin: the gain and
  /// phase margin that follow from it.
  [[nodiscard]] std::string objection(double w, double ratio) const {
    const ScenarioLoop loop = loop_of(w, ratio);
    const double h = loop.settings().period_s;
    const double gain = 1 / (1 - goal_.modulus);
    const double phase = 2 * std::asin(goal_.modulus / 2) * 180 / pi;
    std::vector<std::string> found(rests_.size());
    parallel_for(rests_.size(), [&](std::size_t i) {
      const SampledLoop here = loop.at(rests_[i]);
      const LinearLaw law = here.law(h);
      for (const double factor : {1.0, 1.5, gain}) {
        if (spectral_radius(period_map(here.plant, law, h, here.delay, factor)) >= 1) {
          found[i] = "the gain margin";
          return;
        }
      }
      if (phase_margin_deg(here, h) < phase) found[i] = "the phase margin";
    });
    for (const std::string& each : found) {
      if (!each.empty()) return each;
    }
    return count_objection(loop);
  }

  /// The rest of the truth about gains that do.
  [[nodiscard]] Design result(double w, double ratio) const {
    const ScenarioLoop loop = loop_of(w, ratio);
    const double h = loop.settings().period_s;
    std::vector<Margins> margin(rests_.size());
    std::vector<Modes> mode(rests_.size());
    parallel_for(rests_.size(), [&](std::size_t i) {
      const SampledLoop here = loop.at(rests_[i]);
      margin[i] = margins(here, h);
      mode[i] = modes(here, h);
    });
    Design design;
    design.gains = gains(w, ratio);
    design.w = w;
    design.filter_ratio = has_filter() ? ratio : 0;
    design.postures = static_cast<int>(rests_.size());
    design.modulus = design.gain_margin = design.phase_margin_deg = 1e300;
    for (const Margins& each : margin) {
      design.modulus = std::min(design.modulus, each.modulus);
      design.gain_margin = std::min(design.gain_margin, each.gain);
      design.phase_margin_deg = std::min(design.phase_margin_deg, each.phase_deg);
    }
    for (std::size_t i = 0; i < num_reference_; ++i) {
      design.settling_s = std::max(design.settling_s, mode[i].settling_s);
    }
    return design;
  }

  /// The largest w up to `highest` without objection, to 3 %; 0 when there is none. `why` is what
  /// binds.
  double largest_w(double highest, double ratio, std::string& why) const {
    why = objection(highest, ratio);
    if (why.empty()) return highest;
    double good = 0, bad = highest;
    for (double w = highest / 1.5; w > 1e-3 * highest; w /= 1.5) {
      const std::string still = objection(w, ratio);
      if (still.empty()) {
        good = w;
        break;
      }
      bad = w;
      why = still;
    }
    while (good > 0 && bad > 1.03 * good) {
      const double middle = std::sqrt(good * bad);
      const std::string still = objection(middle, ratio);
      (still.empty() ? good : bad) = middle;
      if (!still.empty()) why = still;
    }
    return good;
  }

 private:
  [[nodiscard]] ScenarioLoop loop_of(double w, double ratio) const {
    experiment::Scenario scenario = scenario_;
    scenario.controller.gains = gains(w, ratio);
    return ScenarioLoop(scenario);
  }

  [[nodiscard]] std::string count_objection(const ScenarioLoop& loop) const {
    const auto& limit = scenario_.plant.drive.torque_limit_Nm;
    const auto bits = scenario_.plant.encoder.resolution_bits;
    if (!limit || !bits) return {};
    const double count = 2 * pi / std::exp2(*bits);
    const auto gain = own_gain(loop.at(rests_.front()).law(loop.settings().period_s));
    for (Eigen::Index i = 0; i < gain.size(); ++i) {
      if (gain[i] * count > goal_.count_share * (*limit)[i]) {
        return fmt::format("the torque of one encoder count on joint {}", i + 1);
      }
    }
    return {};
  }

  const experiment::Scenario& scenario_;
  DesignGoal goal_;
  std::vector<std::string> names_;
  Inertias inertia_;
  std::vector<ReferencePoint> rests_;
  std::size_t num_reference_ = 0;
};

/// The fastest design with w up to `highest`, over the filter ratios.
Design fastest_up_to(const Search& search, double highest, double modulus,
                     const OnProgress& on_progress) {
  Design best;
  std::string last_reason;
  for (const double ratio : filter_ratios) {
    if (on_progress) on_progress(fmt::format("design: a = b = {:g} w", ratio));
    std::string why;
    double w = search.largest_w(highest, ratio, why);
    if (w == 0) {
      last_reason = why;
      continue;
    }
    // Gain and phase margin alone are necessary, not sufficient.
    Design found = search.result(w, ratio);
    for (int i = 0; i < 20 && found.modulus < modulus; ++i) {
      why = "the modulus margin";
      w *= 0.93;
      found = search.result(w, ratio);
    }
    if (found.modulus < modulus) continue;
    found.binds = why.empty() ? "the bandwidth asked for" : why;
    if (best.gains.empty() || found.settling_s < best.settling_s) best = std::move(found);
    if (!search.has_filter()) break;
  }
  if (best.gains.empty()) {
    throw Failure(
        ExitCode::check_said_no,
        fmt::format("no bandwidth up to {:.3g} Hz keeps what is asked for: {} binds; allow a "
                    "shorter period, less delay, a finer encoder or a smaller --margin",
                    highest / (2 * pi), last_reason.empty() ? "the modulus margin" : last_reason));
  }
  return best;
}

void require_feasible(const experiment::Scenario& scenario) {
  const Feasibility feasible = feasibility(scenario);
  if (!feasible.impossible.empty()) {
    throw Failure(ExitCode::check_said_no, feasible.impossible.front());
  }
}

}  // namespace

Design design(const experiment::Scenario& scenario, const DesignGoal& goal,
              const OnProgress& on_progress) {
  require_feasible(scenario);
  const Search search(scenario, goal);
  const double rate = 1 / scenario.loop.period_s;
  if (!goal.settling_s) {
    const double hz = goal.bandwidth_hz.value_or(default_bandwidth_by_rate * rate);
    return fastest_up_to(search, 2 * pi * hz, goal.modulus, on_progress);
  }
  // Settling scales with 1 / w: from the estimate of two real poles, corrected until it is met.
  const double wanted = *goal.settling_s;
  double highest = 7 / wanted;
  Design best = fastest_up_to(search, highest, goal.modulus, on_progress);
  for (int i = 0; i < 4 && best.binds == "the bandwidth asked for"; ++i) {
    if (std::abs(best.settling_s - wanted) < 0.03 * wanted) break;
    highest *= best.settling_s / wanted;
    best = fastest_up_to(search, highest, goal.modulus, on_progress);
  }
  if (best.settling_s > 1.05 * wanted) best.missed = wanted;
  return best;
}

std::vector<std::string> overrides_of(const Design& design) {
  std::vector<std::string> all;
  all.reserve(design.gains.size());
  for (const auto& [name, value] : design.gains) {
    all.push_back(fmt::format("controller.gains.{}=[{:.4g}]", name,
                              fmt::join(value.begin(), value.end(), ", ")));
  }
  return all;
}

std::string scenario_text(const robot::Model& model, const std::string& name,
                          const std::string& urdf, double period_s) {
  std::vector<double> from, to;
  double duration = 2;
  for (int i = 0; i < model.num_joints; ++i) {
    const bool slides =
        model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::prismatic;
    const double low = model.lower[i], high = model.upper[i];
    const bool bounded = std::isfinite(low) && std::isfinite(high);
    const double room = bounded ? 0.25 * (high - low) : 1;
    const double start = bounded ? std::clamp(0.0, low + room, high - room) : 0;
    const double step = std::min(slides ? 0.1 : 0.3, room);
    from.push_back(start);
    to.push_back(start + step);
    // The polynomial of degree 9 peaks at 2.46 times its mean speed.
    if (std::isfinite(model.velocity_limit[i])) {
      duration = std::max(duration, 3 * step / model.velocity_limit[i]);
    }
  }
  duration = std::ceil(10 * duration) / 10;
  const auto ticks = static_cast<long long>(std::ceil((duration + 3) / period_s));
  return fmt::format(
      "name: {}\n"
      "robot:\n  name: arm\n  urdf: {}\n  joints: rigid\n"
      "plant:\n  initial: {{position_rad: [{:.6g}]}}\n  encoder: {{resolution_bits: 20}}\n"
      "reference:\n  point_to_point:\n    from_rad: [{:.6g}]\n    to_rad: [{:.6g}]\n"
      "    start_s: 0.2\n    duration_s: {:g}\n"
      "controller:\n  law: loria_ortega_rigid\n  gains: {{kp: 1, kd: 1, a: 1, b: 1}}\n"
      "  filter: tustin\n  feedforward_lead: half_tick_plus_delay\n"
      "loop: {{mode: lockstep, period_s: {:g}, duration_s: {:.12g}, command_delay: 1}}\n",
      name, urdf, fmt::join(from, ", "), fmt::join(from, ", "), fmt::join(to, ", "), duration,
      period_s, static_cast<double>(ticks) * period_s);
}

}  // namespace tachless::certificate
