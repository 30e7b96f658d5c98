#include "study/measures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <iterator>

#include "base/failure.h"
#include "base/schema.h"
#include "controller/registry.h"
#include "study/loop_yardstick.h"

namespace tachless::study {
namespace {

/// The substitute for the velocity in a law that does not measure it. It is the v_hat that the law
/// logs, or v_ref + nu of a law that filters the error.
class VelocityInUse {
 public:
  explicit VelocityInUse(const controller::LawFacts& law) {
    if (!law.reads_links) return;  // a motor's is none of the links'
    for (std::size_t i = 0; i < law.signals.size(); ++i) {
      if (law.signals[i].name == "nu" && !at_) at_ = i;
      if (law.signals[i].name != "v_hat") continue;
      at_ = i;
      of_error_ = false;
      break;
    }
  }

  /// Less the velocity, |.|^2; NaN for a law that has none.
  [[nodiscard]] double squared_error(const in_process::TickRecord& record) const {
    if (!at_) return NAN;
    const Vector& v_hat = record.controller.value[*at_];
    const Vector error = (of_error_ ? record.reference.v_ref + v_hat : v_hat) - record.truth.v;
    return error.squaredNorm();
  }

 private:
  std::optional<std::size_t> at_;
  bool of_error_ = true;  ///< v_ref is missing in it
};

}  // namespace

std::span<const MeasureColumn> measure_columns(bool comparison) {
  static constexpr MeasureColumn columns[] = {
      {"peak_error", "rad; m", [](const Measures& m) { return m.peak_error; }},
      {"rms_error", "rad; m", [](const Measures& m) { return m.rms_error; }},
      {"settled_error", "rad; m", [](const Measures& m) { return m.settled_error; }},
      {"settled_s", "s",
       [](const Measures& m) {
         return m.verdict.outcome == Outcome::converged ? m.verdict.settled_s : NAN;
       }},
      {"torque_rms", "N m; N", [](const Measures& m) { return m.torque_rms; }},
      {"torque_variation", "N m/s; N/s", [](const Measures& m) { return m.torque_variation; }},
      {"energy", "J", [](const Measures& m) { return m.energy; }},
      {"velocity_error", "rad/s; m/s", [](const Measures& m) { return m.velocity_error; }},
      {"ticks", "", [](const Measures& m) { return static_cast<double>(m.ticks); }},
      {"torque_noise", "N m; N", [](const Measures& m) { return m.torque_noise; }},
      {"largest_period_s", "s", [](const Measures& m) { return m.largest_period_s; }}};
  constexpr std::size_t of_comparison = 2;
  return std::span(columns).first(std::size(columns) - (comparison ? 0 : of_comparison));
}

std::string unit_of(const MeasureColumn& column, const robot::JointLabels& joints) {
  const std::size_t between = column.unit.find("; ");
  const auto turn = std::ranges::count(joints.length, "rad");
  const bool mixed = turn > 0 && turn < std::ssize(joints.length);
  if (mixed || between == std::string_view::npos) return std::string(column.unit);
  return std::string(turn > 0 ? column.unit.substr(0, between) : column.unit.substr(between + 2));
}

std::optional<Measures> measure(const scenario::Scenario& scenario,
                                const std::function<bool(const in_process::TickRecord&)>& on_tick) {
  const double h = scenario.loop.period_s;
  const std::int64_t settled_from = scenario.loop.num_ticks * 3 / 4;
  const VelocityInUse velocity_in_use(controller::law_facts(scenario.controller.law));
  Tracking tracking(scenario.num_joints);
  Yardsticks judged_by = yardsticks(scenario);
  add_loop(judged_by, scenario);
  std::vector<double> saturated(static_cast<std::size_t>(scenario.num_joints));  // ticks
  Vector last_tau;
  Measures measures;  // sums, of squares where they become roots of means
  const auto add = [&](const in_process::TickRecord& record) {
    const Vector& tau = record.applied.tau;
    tracking.add(record.time_s, record.truth.q, record.reference.q_ref, record.truth.theta, tau);
    const double error = (record.truth.q - record.reference.q_ref).norm();
    measures.peak_error = std::max(measures.peak_error, error);
    measures.rms_error += error * error;
    if (record.tick >= settled_from) {
      measures.settled_error += error * error;
      measures.velocity_error += velocity_in_use.squared_error(record);
    }
    measures.torque_rms += tau.squaredNorm();
    if (record.tick > 0) measures.torque_variation += (tau - last_tau).norm();
    last_tau = tau;
    const Vector& speed = scenario.robot.flexible ? record.truth.thetadot : record.truth.v;
    measures.energy += tau.cwiseProduct(speed).cwiseAbs().sum() * h;
    for (std::size_t i = 0; i < saturated.size(); ++i) {
      saturated[i] += record.applied.saturated[i] ? 1 : 0;
    }
  };
  bool whole = true;
  std::optional<std::string> stopped;
  try {
    in_process::run_in_process(scenario, [&](const in_process::TickRecord& record) {
      if (on_tick) whole = on_tick(record);
      if (whole) add(record);
      return whole && measures.peak_error <= diverged_error;
    });
  } catch (const base::Failure& failure) {
    if (failure.code() != base::ExitCode::protective_stop) throw;
    stopped = failure.what();
  }
  if (!whole) return {};
  const std::int64_t ticks = measures.ticks = tracking.num_ticks();
  const auto share = [ticks](double number) { return number / static_cast<double>(ticks); };
  std::ranges::transform(saturated, std::back_inserter(judged_by.saturated_share), share);
  measures.verdict = judge(tracking, judged_by);
  if (stopped) {
    measures.verdict.outcome = Outcome::stopped;
    measures.verdict.reason = *stopped;
  } else if (measures.peak_error > diverged_error) {
    measures.verdict.error = measures.peak_error;
    measures.verdict.outcome = ticks > 1 ? Outcome::diverging : Outcome::stopped;
    measures.verdict.reason = fmt::format(
        "the run starts {:.3g} rad (m) beside its reference; a run is broken off "
        "beyond {:g}: start nearer to the reference",
        measures.peak_error, diverged_error);
  }
  const auto root_mean = [](double& sum, std::int64_t count) {
    sum = count > 0 ? std::sqrt(sum / static_cast<double>(count)) : NAN;
  };
  root_mean(measures.rms_error, ticks);
  root_mean(measures.torque_rms, ticks);
  root_mean(measures.settled_error, ticks - settled_from);
  root_mean(measures.velocity_error, ticks - settled_from);
  if (ticks > 0) measures.torque_variation /= static_cast<double>(ticks) * h;
  return measures;
}

double torque_noise(const scenario::Scenario& scenario) {
  const plant::EncoderSpec& encoder = scenario.plant.encoder;
  if (!encoder.resolution_bits && encoder.noise_std_rad == 0 &&
      encoder.velocity_noise_std_rad_per_s == 0) {
    return NAN;
  }
  std::vector<Vector> torques;
  measure(scenario, [&](const in_process::TickRecord& tick) {
    torques.push_back(tick.command.tau);
    return true;
  });
  if (static_cast<std::int64_t>(torques.size()) != scenario.loop.num_ticks) return NAN;
  scenario::Scenario exact = scenario;
  exact.plant.encoder.resolution_bits.reset();
  exact.plant.encoder.noise_std_rad = 0;
  exact.plant.encoder.velocity_noise_std_rad_per_s = 0;
  double sum = 0;
  const auto run = measure(exact, [&](const in_process::TickRecord& tick) {
    sum += (torques[static_cast<std::size_t>(tick.tick)] - tick.command.tau).squaredNorm();
    return true;
  });
  if (run->ticks != scenario.loop.num_ticks) return NAN;
  return std::sqrt(sum / static_cast<double>(scenario.loop.num_ticks * scenario.num_joints));
}

}  // namespace tachless::study
