#include "certify/prediction.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "base/parallel.h"
#include "base/text.h"
#include "controller/registry.h"
#include "linear/law_answers.h"
#include "numerics/decompositions.h"
#include "numerics/postures.h"
#include "scenario/drive_loop.h"
#include "scenario/largest_friction.h"

namespace tachless::certify {
namespace {

using base::parallel_map;
using base::period_text;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using messages::ReferencePoint;

constexpr int motion_pieces = 96;  // six from one posture of the reference to the next
// Evaluations of a search between two neighbouring postures. Few are enough, since the quantity is
// flat at its extremum.
constexpr int posture_evaluations = 16;

/// The posture of the motion with the largest f, searched from number `k` of those evenly over it.
ReferencePoint worst_near(const linear::ScenarioLoop& loop, std::size_t k,
                          const std::function<double(const ReferencePoint&)>& f) {
  if (!loop.moves()) return loop.rest_at(0);
  constexpr double between = 1.0 / (reference_postures - 1);
  const auto worst = numerics::minimise(
      [&](const VectorXd& share) {
        return share[0] < 0 || share[0] > 1 ? infinity : -f(loop.rest_at(share[0]));
      },
      VectorXd::Constant(1, between * static_cast<double>(k)), between / 2, posture_evaluations);
  return loop.rest_at(worst.x[0]);
}

/// Finds the least limit over the motion and its posture. It begins at the posture that is the
/// least stable at the scenario's period. It goes on with each posture that is unstable at the
/// least limit so far. At the end it searches beside the last posture.
void find_limit(Prediction& result, const linear::ScenarioLoop& scenario_loop,
                const std::vector<linear::SampledLoop>& loops,
                const std::vector<ReferencePoint>& rests, std::size_t first) {
  result.limit_s = linear::largest_stable_period(loops[first], result.settings.period_s);
  std::size_t bound_by = first;
  for (std::size_t round = 0; round < loops.size() && result.limit_s; ++round) {
    const std::vector<double> radius = parallel_map(
        loops.size(), [&](std::size_t i) { return linear::radius_at(loops[i], *result.limit_s); });
    const auto worst = std::ranges::max_element(radius);
    if (*worst < 1) break;
    bound_by = static_cast<std::size_t>(worst - radius.begin());
    result.limit_s = linear::largest_stable_period(loops[bound_by], *result.limit_s);
  }
  result.limit_q = found_posture(rests[bound_by].q_ref);
  if (!result.limit_s) return;
  const auto radius = [&](const ReferencePoint& rest) {
    return linear::radius_at(scenario_loop.at(rest), *result.limit_s);
  };
  const ReferencePoint worst = worst_near(scenario_loop, bound_by, radius);
  if (radius(worst) < 1) return;
  result.limit_s = linear::largest_stable_period(scenario_loop.at(worst), *result.limit_s);
  result.limit_q = found_posture(worst.q_ref);
}

/// Spectral radius of the product of the one-period maps over a motion.
struct OverMotion {
  double per_period, product;
};

/// Returns the radius over the motion in pieces, each of which stands for equally many periods.
OverMotion radius_over_motion(const linear::ScenarioLoop& loop) {
  const double h = loop.settings().period_s;
  const linear::ScenarioLoop::Motion& motion = loop.motion();
  const auto ticks = std::max<std::int64_t>(1, std::llround((motion.end_s - motion.begin_s) / h));
  const auto count = std::min<std::int64_t>(motion_pieces, ticks);
  const auto first_tick = [&](std::int64_t k) { return k * ticks / count; };
  const std::vector<MatrixXd> maps =
      parallel_map(static_cast<std::size_t>(count), [&](std::size_t i) {
        const auto k = static_cast<std::int64_t>(i);
        const std::int64_t begin = first_tick(k), length = first_tick(k + 1) - begin;
        const double middle = static_cast<double>(begin) + static_cast<double>(length - 1) / 2;
        return linear::power(loop.map_at(motion.begin_s + h * middle), length);
      });
  const double over_pieces = linear::radius_along(
      [&](int k) { return maps[static_cast<std::size_t>(k)]; }, static_cast<int>(count));
  return {std::pow(over_pieces, static_cast<double>(count) / static_cast<double>(ticks)),
          std::pow(over_pieces, static_cast<double>(count))};
}

/// Sets `radius` and `growth`. @param end_radius at rest at the end of the motion
void find_radius(Prediction& result, const linear::ScenarioLoop& loop,
                 const scenario::Scenario& scenario, double end_radius) {
  result.radius = end_radius;
  if (!loop.moves()) return;
  const OverMotion over = radius_over_motion(loop);
  if (loop.motion().repeats) {
    result.radius = over.per_period;
  } else if (loop.motion().end_s < scenario.loop.duration_s) {
    result.growth = over.product > 1 ? over.product : 0;
  } else {
    result.radius = std::max(over.per_period, end_radius);
  }
}

void find_margins(Prediction& result, const linear::ScenarioLoop& scenario_loop,
                  const std::vector<linear::SampledLoop>& loops,
                  std::vector<ReferencePoint> rests) {
  const double h = result.settings.period_s;
  std::vector<linear::Margins> all =
      parallel_map(loops.size(), [&](std::size_t i) { return linear::margins(loops[i], h); });
  const auto first = std::ranges::min_element(all, {}, &linear::Margins::modulus) - all.begin();
  rests.push_back(
      worst_near(scenario_loop, static_cast<std::size_t>(first), [&](const ReferencePoint& rest) {
        return -linear::modulus_margin(scenario_loop.at(rest), h);
      }));
  all.push_back(linear::margins(scenario_loop.at(rests.back()), h));
  const auto least = [&](double linear::Margins::*one) {
    return (*std::ranges::min_element(all, {}, one)).*one;
  };
  result.margins =
      linear::Margins{least(&linear::Margins::modulus),
                      least(&linear::Margins::modulus_independent),
                      least(&linear::Margins::gain),
                      std::ranges::max(all, {}, &linear::Margins::least_gain).least_gain,
                      least(&linear::Margins::phase_deg),
                      least(&linear::Margins::delay_s)};
  const auto at = std::ranges::min_element(all, {}, &linear::Margins::modulus) - all.begin();
  result.margin_q = found_posture(rests[static_cast<std::size_t>(at)].q_ref);
}

/// Finds the least of each number over the postures, and an unstable pattern at the posture with
/// the fewest commands.
void find_missed(Prediction& result, const std::vector<linear::SampledLoop>& loops) {
  const double h = result.settings.period_s;
  const std::vector<linear::MissedTicks> all =
      parallel_map(loops.size(), [&](std::size_t i) { return linear::missed_ticks(loops[i], h); });
  const auto worst = std::ranges::min_element(all, {}, &linear::MissedTicks::commands);
  result.missed = *worst;
  for (const linear::MissedTicks& each : all) {
    if (each.measurements)
      result.missed->measurements = std::min(*each.measurements, *result.missed->measurements);
  }
  linear::find_unstable_pattern(loops[static_cast<std::size_t>(worst - all.begin())], h,
                                *result.missed);
}

void find_settling(Prediction& result, const linear::ScenarioLoop& scenario_loop,
                   const std::vector<linear::SampledLoop>& loops, std::size_t slowest) {
  const double h = result.settings.period_s;
  std::vector<linear::Modes> all =
      parallel_map(loops.size(), [&](std::size_t i) { return linear::modes(loops[i], h); });
  result.modes = all[slowest];
  const auto first = std::ranges::max_element(all, {}, &linear::Modes::settling_s) - all.begin();
  all.push_back(linear::modes(
      scenario_loop.at(worst_near(scenario_loop, static_cast<std::size_t>(first),
                                  [&](const ReferencePoint& rest) {
                                    return linear::modes(scenario_loop.at(rest), h).settling_s;
                                  })),
      h));
  const linear::Modes& longest = *std::ranges::max_element(all, {}, &linear::Modes::settling_s);
  result.modes.settling_s = longest.settling_s;
  result.modes.settling_mean_s = longest.settling_mean_s;
}

/// Finds gain, stiffness and rest error, each the worst over the postures.
void find_stiffness(Prediction& result, const scenario::Scenario& scenario,
                    const std::vector<linear::SampledLoop>& loops) {
  const double h = result.settings.period_s;
  const auto laws = parallel_map(loops.size(), [&](std::size_t i) { return loops[i].law(h); });
  const VectorXd held = scenario::largest_friction(scenario);
  const auto& drive = scenario.robot.flexible;
  const VectorXd springs = drive ? VectorXd(drive->stiffness) : VectorXd();
  const VectorXd scale = scenario.plant.drive.torque_scale;
  VectorXd least = VectorXd::Constant(held.size(), infinity), error = 0 * held, gain = error;
  const auto loop = scenario::drive_loop(scenario);
  const VectorXd inside = loop ? VectorXd(scale.cwiseProduct(VectorXd(loop->kp))) : 0 * held;
  for (const linear::LinearLaw& law : laws) {
    MatrixXd K = linear::stiffness_at_rest(law, scale, springs, h);
    K.diagonal() += inside;
    gain = gain.cwiseMax(own_gain(law));
    least = least.cwiseMin(K.diagonal());
    const auto moved = numerics::solution(K, held.asDiagonal());
    error = error.cwiseMax(moved ? VectorXd(moved->cwiseAbs().rowwise().sum())
                                 : VectorXd(held.cwiseQuotient(K.diagonal())));
  }
  result.gain_Nm_per_rad = gain;
  result.stiffness = least;
  if (!held.isZero(0)) result.rest_error = error;
}

std::vector<linear::SampledLoop> loops_at(const linear::ScenarioLoop& loop,
                                          const std::vector<ReferencePoint>& rests) {
  return parallel_map(rests.size(), [&](std::size_t i) { return loop.at(rests[i]); });
}

/// A round period below the limit: one or two digits.
double round_below(double limit_s) {
  const double wanted = 0.8 * limit_s;
  const double decade = std::pow(10, std::floor(std::log10(wanted)));
  for (const double digit : {5.0, 2.0, 1.0}) {
    if (digit * decade <= wanted) return digit * decade;
  }
  return decade;
}

std::string rate_text(double period_s) {
  const double hz = 1 / period_s;
  return hz >= 1000 ? fmt::format("{:.4g} kHz", hz / 1000) : fmt::format("{:.4g} Hz", hz);
}

/// Returns the keys of the emulated arm that no linear loop contains.
std::string uncounted(const plant::Spec& plant, const scenario::RobotSpec& robot) {
  std::vector<std::string_view> all;
  const auto add = [&](bool there, std::string_view what) {
    if (there) all.push_back(what);
  };
  add(plant.drive.command_age_jitter_ticks > 0, "plant.drive.command_age_jitter_ticks");
  add(!plant.drive.torque_offset_Nm.isZero(0), "plant.drive.torque_offset_Nm");
  add(!plant.drive.friction_rise_Nm.isZero(0), "plant.drive.friction_rise_Nm");
  add(!plant.encoder.eccentricity_rad.isZero(0), "plant.encoder.eccentricity_rad");
  add(robot.flexible && !robot.flexible->motor_coulomb_friction_Nm.isZero(0),
      "robot.joints.flexible.motor_coulomb_friction_Nm");
  add(!plant.mujoco.model.empty(), "contacts (plant.mujoco): all numbers are of free motion");
  return base::joined(all);
}

/// Fills in what follows `unknown` and `settings`. @throw NoLinearModel
void examine(Prediction& result, const scenario::Scenario& scenario, linear::Effort effort,
             const linear::OnProgress& tell, const linear::LawAnswers& answers) {
  const double h = result.settings.period_s;

  tell("sampled loop: largest period");
  const linear::ScenarioLoop scenario_loop(scenario, answers);
  const std::vector<ReferencePoint> rests = scenario_loop.rest_points(reference_postures);
  const std::vector<linear::SampledLoop> loops = loops_at(scenario_loop, rests);
  const std::vector<double> radius =
      parallel_map(loops.size(), [&](std::size_t i) { return linear::radius_at(loops[i], h); });
  const auto slowest = static_cast<std::size_t>(std::ranges::max_element(radius) - radius.begin());
  find_limit(result, scenario_loop, loops, rests, slowest);
  if (result.limit_s.value_or(0) < h) result.unstable_q = result.limit_q;
  find_settling(result, scenario_loop, loops, slowest);

  tell("sampled loop: along the reference");
  if (answers) {  // whose states at two postures need not be the same: at rest
    result.radius = radius[slowest];
  } else {
    find_radius(result, scenario_loop, scenario, radius.back());
  }
  result.stable = result.radius < 1;

  find_stiffness(result, scenario, loops);
  if (scenario.plant.encoder.resolution_bits) {
    result.count_Nm = result.gain_Nm_per_rad.cwiseProduct(
        VectorXd(scenario::encoder_count(scenario, *scenario.model)));
  }
  const auto& joints = scenario.model->joint_types;
  if (std::ranges::find(joints, robot::JointType::prismatic) != joints.end()) {
    result.stiffness_unit = "N m/rad (N/m)";
    result.torque_unit = "N m (N)";
  }
  if (effort == linear::Effort::quick || result.unstable_q.size() > 0) return;
  tell("sampled loop: margins");
  find_margins(result, scenario_loop, loops, rests);
  if (effort == linear::Effort::margins) return;
  tell("sampled loop: missed ticks");
  find_missed(result, loops);
}

}  // namespace

VectorXd own_gain(const linear::LinearLaw& law) {
  const Eigen::Index n = law.D.rows();
  VectorXd gain = VectorXd::Zero(n);
  for (std::size_t i = 0; i < law.measured.size(); ++i) {
    if (law.measured[i] != linear::Part::q && law.measured[i] != linear::Part::theta) continue;
    const auto block = law.D.middleCols(static_cast<Eigen::Index>(i) * n, n);
    gain = gain.cwiseMax(block.diagonal().cwiseAbs());
  }
  return gain;
}

Vector found_posture(const Vector& q) {
  constexpr double beside = 1e-6;  // [rad; m]
  return (q.array().abs() < beside).select(0.0, q);
}

Prediction analyse(const scenario::Scenario& scenario, linear::Effort effort,
                   const linear::OnProgress& tell, const linear::LawAnswers& answers) {
  Prediction result;
  result.settings = controller::law_settings(scenario);
  result.not_counted = uncounted(scenario.plant, scenario.robot);
  if (!answers) {
    result.unknown = controller::law_facts(scenario.controller.law).no_linearisation;
    if (!result.unknown.empty()) return result;
  }
  const Prediction begun = result;
  try {
    examine(result, scenario, effort, tell, answers);
  } catch (const linear::NoLinearModel& why) {
    result = begun;
    result.unknown = why.what();
  }
  return result;
}

Vector stiffness(const scenario::Scenario& scenario) {
  if (!controller::law_facts(scenario.controller.law).no_linearisation.empty()) return {};
  const linear::ScenarioLoop loop(scenario);
  Prediction rest;
  rest.settings = loop.settings();
  find_stiffness(rest, scenario, loops_at(loop, loop.rest_points(reference_postures)));
  if (rest.rest_error.size() == 0) return rest.stiffness;
  const VectorXd held = scenario::largest_friction(scenario);
  return (held.array() > 0).select(held.cwiseQuotient(rest.rest_error), rest.stiffness);
}

std::string limit_text(const std::optional<double>& limit_s) {
  if (!limit_s) return "none: unstable at any period";
  return *limit_s >= linear::longest_s ? "1 s or more" : period_text(*limit_s);
}

std::string settling_text(double seconds) { return fmt::format("{:.2g} s", seconds); }

std::string margins_text(const linear::Margins& margins) {
  const std::string most =
      std::isinf(margins.gain) ? "without limit" : fmt::format("{:.3g}", margins.gain);
  return fmt::format("gain {}{}, phase {:.0f} deg, delay {}",
                     margins.least_gain > 0 ? fmt::format("{:.3g} to ", margins.least_gain) : "",
                     most, margins.phase_deg,
                     std::isinf(margins.delay_s) ? "without limit" : period_text(margins.delay_s));
}

std::string modulus_text(const linear::Margins& margins) {
  return fmt::format("{:.2g} (common to all torques), {:.2g} (independent)", margins.modulus,
                     margins.modulus_independent);
}

std::string pattern_text(int in_a_row) {
  if (in_a_row == 0) return "not even single ones were found to be stable (searched, not proved)";
  return fmt::format("any pattern of {}{} in a row is stable (searched, not proved)",
                     in_a_row == linear::most_missed ? "" : "at most ", in_a_row);
}

std::string missed_text(const linear::MissedTicks& missed) {
  std::string text = pattern_text(missed.commands);
  if (missed.unstable) {
    text += fmt::format("; the repeated pattern of {} missed and {} received is unstable",
                        *missed.unstable, missed.hits);
  }
  return text;
}

std::string friction_text(const Prediction& prediction) {
  if (prediction.rest_error.size() == 0) return "";
  return fmt::format("dry friction may hold a joint at rest up to F_c/kp = {} beside its reference",
                     list_text(prediction.rest_error));
}

std::string list_text(const VectorXd& values) {
  // Rounding, such as sin(pi) = 1e-16, is shown as 0.
  const VectorXd shown = (values.array().abs() < 1e-12).select(0.0, values);
  return fmt::format("[{:.4g}]", fmt::join(shown.begin(), shown.end(), ", "));
}

std::string no_region(const Prediction& prediction) {
  if (!prediction.unknown.empty()) return {};
  if (!prediction.stable) {
    return "the sampled loop is unstable, and a region holds in continuous time alone";
  }
  if (prediction.growth > 0) {
    return "errors of the sampled loop grow over the motion, and a region holds in continuous time "
           "alone";
  }
  return {};
}

std::string growth_text(const Prediction& prediction) {
  const double time_s =
      std::numbers::ln2 * prediction.settings.period_s / std::log(prediction.radius);
  constexpr double longest = 3600;  // a pole on the unit circle, but for rounding
  return time_s > 0 && time_s < longest ? "errors double in " + period_text(time_s)
                                        : std::string("errors do not decay");
}

std::string text(const Prediction& prediction) {
  if (!prediction.unknown.empty()) {
    return fmt::format(
        "no prediction: the law cannot be linearised ({}); whether the loop is stable is not known "
        "before the run",
        prediction.unknown);
  }
  const int ticks = prediction.settings.command_delay;
  const std::string at =
      fmt::format("at {} with {} tick{} of delay", rate_text(prediction.settings.period_s), ticks,
                  ticks == 1 ? "" : "s");
  const std::string limit = limit_text(prediction.limit_s);
  if (!prediction.stable) {
    if (!prediction.limit_s) {
      return fmt::format("unstable {}, and at any other period: {}", at, growth_text(prediction));
    }
    return fmt::format("unstable {}: largest stable period {}, {}", at, limit,
                       growth_text(prediction));
  }
  if (prediction.growth > 0) {
    return fmt::format(
        "stable {} where the motion ends: errors grow {:.2g}-fold over the motion, then decay; "
        "largest stable period at rest {}",
        at, prediction.growth, limit);
  }
  if (prediction.unstable_q.size() > 0) {
    return fmt::format(
        "stable {} along the motion, but not at rest at q = {}; largest stable period at rest {}",
        at, list_text(prediction.unstable_q), limit);
  }
  return fmt::format("stable {}: limit {}, settles in {}", at, limit,
                     settling_text(prediction.modes.settling_s));
}

std::optional<double> stable_period(const Prediction& prediction) {
  if (!prediction.limit_s) return std::nullopt;
  return round_below(std::min(*prediction.limit_s, prediction.settings.period_s));
}

std::string refusal(const Prediction& prediction, const std::string& scenario_file) {
  const std::optional<double> period_s = stable_period(prediction);
  const std::string remedy = period_s ? fmt::format("type --set loop.period_s={:g}", *period_s)
                                      : std::string("choose other gains");
  return fmt::format("{}: {}; {} or --force to run it as it is; tachless certify prints more",
                     scenario_file, text(prediction), remedy);
}

}  // namespace tachless::certify
