#include "study/measures.h"

#include <cmath>

#include "diagnostics/failure.h"
#include "schema/schema.h"
#include "study/in_process_loop.h"
#include "study/velocity_in_use.h"

namespace tachless::study {
namespace {

/// Sums over a run.
class Sums {
 public:
  explicit Sums(const experiment::Scenario& scenario)
      : period_s_(scenario.loop.period_s),
        settled_from_(scenario.loop.num_ticks * 3 / 4),
        flexible_(scenario.robot.flexible.has_value()),
        velocity_in_use_(scenario.controller.law),
        tracking_(scenario.num_joints),
        saturated_(static_cast<std::size_t>(scenario.num_joints)) {}

  void add(const TickRecord& record) {
    const robot::Vector& tau = record.applied.tau;
    const robot::Vector& speed = flexible_ ? record.truth.thetadot : record.truth.v;
    tracking_.add(record.time_s, record.truth.q, record.reference.q_ref, record.truth.theta, tau);
    const double error = (record.truth.q - record.reference.q_ref).norm();
    peak_error_ = std::max(peak_error_, error);
    error_squared_ += error * error;
    if (record.tick >= settled_from_) {
      settled_squared_ += error * error;
      const robot::Vector off = velocity_in_use_.error(record);
      velocity_squared_ += off.size() == 0 ? NAN : off.squaredNorm();
    }
    torque_squared_ += tau.squaredNorm();
    if (record.tick > 0) variation_ += (tau - last_tau_).norm();
    last_tau_ = tau;
    energy_ += tau.cwiseProduct(speed).cwiseAbs().sum() * period_s_;
    for (std::size_t i = 0; i < saturated_.size(); ++i) {
      saturated_[i] += record.applied.saturated[i] ? 1 : 0;
    }
  }

  [[nodiscard]] bool gone_beyond() const { return peak_error_ > gone; }

  [[nodiscard]] Measures result() const {
    Measures measures;
    const std::int64_t ticks = tracking_.num_ticks();
    measures.ticks = ticks;
    measures.observed = observe(tracking_, saturated_);
    if (gone_beyond()) measures.observed.outcome = Outcome::diverging;
    measures.peak_error = peak_error_;
    measures.rms_error = root_mean(error_squared_, ticks);
    measures.settled_error = root_mean(settled_squared_, ticks - settled_from_);
    measures.torque_rms = root_mean(torque_squared_, ticks);
    if (ticks > 0)
      measures.torque_variation = variation_ / (static_cast<double>(ticks) * period_s_);
    measures.energy = energy_;
    measures.velocity_error = root_mean(velocity_squared_, ticks - settled_from_);
    return measures;
  }

 private:
  static double root_mean(double sum, std::int64_t count) {
    return count > 0 ? std::sqrt(sum / static_cast<double>(count)) : NAN;
  }

  double period_s_;
  std::int64_t settled_from_;
  bool flexible_;
  VelocityInUse velocity_in_use_;
  Tracking tracking_;
  std::vector<std::int64_t> saturated_;
  double peak_error_ = 0, error_squared_ = 0, settled_squared_ = 0, torque_squared_ = 0;
  double variation_ = 0, energy_ = 0, velocity_squared_ = 0;
  robot::Vector last_tau_;
};

}  // namespace

std::string_view Measures::outcome() const {
  return stopped.empty() ? schema::name_of(observed.outcome) : "stopped";
}

const std::vector<MeasureColumn>& measure_columns() {
  static const std::vector<MeasureColumn> columns = {
      {"peak_error", "rad; m", [](const Measures& m) { return m.peak_error; }},
      {"rms_error", "rad; m", [](const Measures& m) { return m.rms_error; }},
      {"settled_error", "rad; m", [](const Measures& m) { return m.settled_error; }},
      {"settled_s", "s",
       [](const Measures& m) {
         return m.observed.outcome == Outcome::converged ? m.observed.settled_s : NAN;
       }},
      {"torque_rms", "N m; N", [](const Measures& m) { return m.torque_rms; }},
      {"torque_variation", "N m/s; N/s", [](const Measures& m) { return m.torque_variation; }},
      {"energy", "J", [](const Measures& m) { return m.energy; }},
      {"velocity_error", "rad/s; m/s", [](const Measures& m) { return m.velocity_error; }},
      {"ticks", "", [](const Measures& m) { return static_cast<double>(m.ticks); }}};
  return columns;
}

std::optional<Measures> measure(const experiment::Scenario& scenario,
                                const std::function<bool(const TickRecord&)>& on_tick) {
  Sums sums(scenario);
  bool whole = true;
  std::string stopped;
  try {
    run_in_process(scenario, [&](const TickRecord& record) {
      if (on_tick) whole = on_tick(record);
      if (whole) sums.add(record);
      return whole && !sums.gone_beyond();
    });
  } catch (const diagnostics::Failure& failure) {
    if (failure.code() != diagnostics::ExitCode::protective_stop) throw;
    stopped = failure.what();
  }
  if (!whole) return {};
  Measures measures = sums.result();
  measures.stopped = stopped;
  return measures;
}

}  // namespace tachless::study
