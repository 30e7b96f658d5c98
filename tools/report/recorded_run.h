#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "logger/run_log.h"
#include "lyapunov/stability_certificate.h"
#include "report/contacts.h"
#include "report/decay.h"
#include "report/visuals.h"
#include "robot/model.h"
#include "study/tracking.h"
#include "study/verdict.h"

namespace tachless::report {

/// Ticks at which a condition held.
using Stretches = logger::TickRanges<500>;

/// A signal that the law declares, as the log names it.
struct LoggedSignal {
  std::string name;
  std::string unit;     ///< unit on a revolute joint
  std::size_t row = 0;  ///< row of messages::LawSignals
  std::vector<study::Envelope> joints;
  std::vector<double> last;  ///< last value of each joint in the log

  /// Returns whether the values of this joint equal those of the first joint, for example in the
  /// estimate of a load.
  [[nodiscard]] bool repeats_first(std::size_t joint) const {
    return unit != "rad/s" && joint > 0 && joints[joint].points() == joints[0].points();
  }
};

/// One joint's applied torque, and the torque that the scenario's robot takes for the recorded
/// motion. Both are below 15 Hz.
struct ModelTorque {
  study::Envelope applied, model;
  double error = 0;  ///< rms of the difference over the peak
};

/// A run with all that a report shows of it, in memory that does not grow with its length. Link
/// angles are the true ones if the log has them, else the measured ones. The tracking leaves out a
/// tick that lacks angle, reference or torque.
struct RecordedRun : logger::RunDescription {
  std::filesystem::path log;
  std::size_t number = 0;  ///< among the runs of a report
  std::string label;       ///< label in legends
  robot::JointLabels joints;
  Visuals visuals;  ///< none: the robot is drawn from simple shapes

  study::Tracking tracking;
  study::Verdict verdict;
  std::vector<std::optional<Decay>> decay;  ///< of the joints' position errors, at rest
  std::vector<LoggedSignal> signals;        ///< signals of the law, except position errors

  study::Envelope lyapunov;
  std::string lyapunov_formula;  ///< empty: the law has none here
  std::optional<lyapunov::CertifiedRun> certified;
  std::optional<double> above_bound_s;  ///< time at which V first exceeded the certified bound
  std::optional<Decay> lyapunov_decay;

  std::vector<study::Envelope> disturbance;  ///< per joint [N m]; empty: the scenario has none
  /// Torques that a real arm reported, per joint [N m]; empty: not reported.
  std::vector<study::Envelope> accepted_torque, measured_torque;
  std::vector<ModelTorque> model_torque;  ///< empty: flexible joints, or less than 2 s
  std::vector<Stretches> saturated;       ///< per joint
  Contacts contacts;
  study::Envelope contact_force;  ///< [N]
  Stretches command_missed;
  Stretches protective_stop;
  logger::RunSummary summary;
  logger::Damage damage;
  /// The run's summary.json beside the log, if it is of this run; null otherwise.
  nlohmann::json outcome;

  /// Makes a run of which nothing has been read.
  explicit RecordedRun(logger::RunDescription run);

  /// Returns an entry of `outcome`; null if it is not there.
  [[nodiscard]] nlohmann::json outcome_of(const char* key) const {
    return outcome.is_object() ? outcome.value(key, nlohmann::json()) : nlohmann::json();
  }
  /// Returns the share of `stretches` in the ticks of which the log has anything.
  [[nodiscard]] double share_of(const Stretches& stretches) const {
    return static_cast<double>(stretches.count) / static_cast<double>(summary.ticks);
  }
  /// Returns the time at which the last tick of the log ends.
  [[nodiscard]] double end_s() const {
    return static_cast<double>(summary.last_tick + 1) * info.period_s;
  }
  /// Returns the first and the last second of each range of ticks.
  [[nodiscard]] std::vector<std::pair<double, double>> seconds(
      const std::vector<logger::TickRange>& ranges) const;
};

using Certify = std::function<std::optional<lyapunov::CertifiedRun>(const scenario::Scenario&)>;

/// Reads `log` from its start to its end. `run` chooses among several; without `certify` the cross
/// terms of V have no weight. The log says how the run ended (logger::RunSummary::stop_reason).
/// @throw base::Failure(bad_usage) as logger::RunLog::open, or when the robot or law in the
/// log cannot be made.
RecordedRun read_recorded_run(const std::filesystem::path& log,
                              std::optional<std::int64_t> run = {}, const Certify& certify = {});

/// Gives each run its number, and a label that differs from the other labels: scenario, else law,
/// else log.
void label(std::vector<RecordedRun>& runs);

}  // namespace tachless::report
