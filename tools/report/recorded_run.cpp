#include "report/recorded_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <tuple>
#include <variant>
#include <vector>

#include "base/file_text.h"
#include "base/json_text.h"
#include "certify/prediction.h"
#include "controller/registry.h"
#include "controller/stepped_law.h"
#include "identify/least_squares.h"
#include "logger/tick_messages.h"
#include "study/loop_yardstick.h"

namespace tachless::report {
namespace {

// V of a flexible robot takes microseconds, and is smooth.
constexpr std::int64_t most_evaluations = 50'000;
/// The most ticks of a motion for the model's torque: a run of 100 s at 1 kHz.
constexpr std::size_t most_motion = 100'000;
constexpr double shortest_motion_s = 2;

void add_tracking(study::Tracking& tracking, const logger::TickRecord& record, double t_s) {
  Vector q, theta;
  if (record.truth) {
    q = record.truth->q;
    theta = record.truth->theta;
  } else if (record.measurement) {
    q = messages::links_of(*record.measurement);
    if (const auto* const motors = messages::parts_of(*record.measurement)[2]) theta = *motors;
  }
  if (q.size() == 0 || !record.reference || !(record.truth || record.command)) return;
  tracking.add(t_s, q, record.reference->q_ref, theta,
               record.truth ? record.truth->tau : record.command->tau);
}

/// Measured positions and applied torques from the start to the first tick that lacks them.
class Motion {
 public:
  void add(const logger::TickRecord& record) {
    Vector q;
    if (record.measurement) q = messages::links_of(*record.measurement);
    ended_ = ended_ || q.size() == 0 || !record.truth || ticks_ == most_motion ||
             record.truth->fault == messages::truth::DriveFault::protective_stop ||
             record.tick != static_cast<std::int64_t>(ticks_);
    if (ended_) return;
    q_.add(q);
    tau_.add(record.truth->tau);
    ++ticks_;
  }

  [[nodiscard]] std::vector<ModelTorque> torques(const scenario::Scenario& scenario) const {
    const Eigen::Index n = scenario.num_joints;
    if (scenario.robot.flexible || scenario.plant.dry_run || scenario.plant.zero_torque ||
        static_cast<double>(ticks_) * scenario.loop.period_s < shortest_motion_s) {
      return {};
    }
    const identify::Recording recording{"", scenario, q_.matrix(n), tau_.matrix(n)};
    const identify::Regression found =
        identify::regression(recording, identify::Parameters(scenario, {}));
    std::vector<ModelTorque> result(static_cast<std::size_t>(n));
    for (Eigen::Index row = 0; row < found.joint.size(); ++row) {
      ModelTorque& torque = result[static_cast<std::size_t>(found.joint[row])];
      torque.applied.add(found.time_s[row], found.applied[row]);
      torque.model.add(found.time_s[row], found.applied[row] - found.torque[row]);
    }
    const Eigen::VectorXd error = found.residual(Eigen::VectorXd(0));
    for (Eigen::Index i = 0; i < n; ++i) {
      result[static_cast<std::size_t>(i)].error = error[i] / std::max(1e-300, found.peak[i]);
    }
    return result;
  }

 private:
  identify::TickRows q_, tau_;
  std::size_t ticks_ = 0;
  bool ended_ = false;
};

nlohmann::json read_outcome(const RecordedRun& run) {
  const auto text = base::file_text(run.log.parent_path() / "summary.json");
  const nlohmann::json json = base::json_or_null(text.value_or(""));
  const bool ours = json.is_object() && json.contains("run_id") &&
                    json["run_id"].is_number_integer() &&
                    json["run_id"].get<std::int64_t>() == run.run_id;
  return ours ? json : nlohmann::json();
}

/// Returns the law's signals, except for signals in rad. These are position errors, and the report
/// has them from the true positions.
std::vector<LoggedSignal> declared_signals(const messages::RunInfo& info, std::size_t num_joints) {
  std::vector<LoggedSignal> signals;
  std::size_t row = 0;
  for (const auto& [name, unit] :
       messages::parse_signals(info.signals).value_or(std::vector<messages::Signal>())) {
    if (unit != "rad") {
      signals.push_back({std::string(name),
                         std::string(unit),
                         row,
                         std::vector<study::Envelope>(num_joints),
                         {}});
    }
    ++row;
  }
  return signals;
}

void add_signals(RecordedRun& run, const messages::LawSignals& values, double t_s) {
  for (LoggedSignal& signal : run.signals) {
    const Vector& value = values.value[signal.row];
    signal.last.assign(value.begin(), value.end());
    for (std::size_t joint = 0; joint < signal.joints.size(); ++joint) {
      signal.joints[joint].add(t_s, value[static_cast<Eigen::Index>(joint)]);
    }
  }
}

void add_drives(RecordedRun& run, const logger::TickRecord& record, double t_s) {
  for (std::size_t joint = 0; joint < run.disturbance.size(); ++joint) {
    run.disturbance[joint].add(t_s, record.truth->disturbance[static_cast<Eigen::Index>(joint)]);
  }
  for (std::size_t joint = 0; joint < run.saturated.size(); ++joint) {
    if (record.truth->saturated[joint]) run.saturated[joint].add(record.tick);
  }
  if (record.truth->fault == messages::truth::DriveFault::command_missed) {
    run.command_missed.add(record.tick);
  }
  if (record.truth->fault == messages::truth::DriveFault::protective_stop) {
    run.protective_stop.add(record.tick);
  }
}

void add_arm_torque(RecordedRun& run, const messages::truth::ArmTorque& arm, double t_s) {
  using messages::truth::Told;
  for (const auto& [one, values, into] :
       {std::tuple{Told::accepted, &arm.accepted, &run.accepted_torque},
        std::tuple{Told::measured, &arm.measured, &run.measured_torque}}) {
    if (!arm.tells(one)) continue;
    into->resize(run.joints.name.size());
    for (std::size_t joint = 0; joint < into->size(); ++joint) {
      (*into)[joint].add(t_s, (*values)[static_cast<Eigen::Index>(joint)]);
    }
  }
}

void add_lyapunov(RecordedRun& run, const controller::LyapunovFunction& lyapunov,
                  const logger::TickRecord& record, double t_s) {
  const auto& truth = record.truth;
  const auto& signals = record.controller_state;
  const auto declared = controller::law_facts(run.scenario.controller.law).signals.size();
  if (!truth || !record.reference || !signals || signals->num != static_cast<int>(declared)) return;
  double V = NAN;
  try {
    V = lyapunov({truth->q, truth->v, truth->theta, truth->thetadot, *signals}, *record.reference);
  } catch (const std::logic_error&) {
    // A damaged posture without an inertia matrix has no V; the curve lacks a point there.
  }
  if (!std::isfinite(V)) return;
  run.lyapunov.add(t_s, V);
  if (!run.certified || run.above_bound_s) return;
  // The bound is of continuous time. A torque that is held over a tick, or an encoder's count, may
  // leave a small V: that is no violation.
  const lyapunov::CertifiedRun& certified = *run.certified;
  const double margin = 1e-3 * (std::isfinite(certified.level) ? certified.level : certified.V0);
  if (V > certified.bound(t_s) + margin) run.above_bound_s = t_s;
}

}  // namespace

RecordedRun::RecordedRun(logger::RunDescription run)
    : RunDescription(std::move(run)),
      label(scenario.name),
      joints(robot::joint_labels(*scenario.model)),
      tracking(layout.num_joints),
      saturated(joints.name.size()) {
  signals = declared_signals(info, joints.name.size());
  if (logger::has_disturbance(scenario)) disturbance.resize(joints.name.size());
}

std::vector<std::pair<double, double>> RecordedRun::seconds(
    const std::vector<logger::TickRange>& ranges) const {
  std::vector<std::pair<double, double>> result;
  result.reserve(ranges.size());
  for (const auto& [first, last] : ranges) {
    result.emplace_back(static_cast<double>(first) * info.period_s,
                        (static_cast<double>(last) + 1) * info.period_s);
  }
  return result;
}

RecordedRun read_recorded_run(const std::filesystem::path& path, std::optional<std::int64_t> wanted,
                              const Certify& certify) {
  logger::RunLog log = logger::RunLog::open(path, wanted);
  RecordedRun run(log.description());
  run.log = log.path();
  if (certify) run.certified = certify(run.scenario);
  const auto lyapunov = controller::lyapunov_function(
      run.scenario, run.certified ? run.certified->weights : lyapunov::Weights());
  if (lyapunov) {
    run.lyapunov_formula = controller::law_facts(run.scenario.controller.law).lyapunov_formula;
  }
  const std::int64_t stride = std::max<std::int64_t>(1, run.info.num_ticks / most_evaluations);
  const double period_s = run.info.period_s;
  logger::TickRecord record;
  Motion motion;
  while (log.next(record)) {
    motion.add(record);
    const double t_s = static_cast<double>(record.tick) * period_s;
    add_tracking(run.tracking, record, t_s);
    if (record.controller_state) add_signals(run, *record.controller_state, t_s);
    if (record.truth) add_drives(run, record, t_s);
    if (record.contact) run.contact_force.add(t_s, record.contact->force);
    if (record.arm_torque) add_arm_torque(run, *record.arm_torque, t_s);
    run.contacts.add(record, t_s);
    const bool changed = !log.summary().gains.empty();  // the bound holds from the start alone
    if (lyapunov && !changed && record.tick % stride == 0) add_lyapunov(run, lyapunov, record, t_s);
  }
  run.model_torque = motion.torques(run.scenario);
  if (lyapunov) run.lyapunov_decay = fit_decay(run.lyapunov.points());
  for (const study::JointTracking& joint : run.tracking.joints()) {
    std::vector<study::Point> error = joint.abs_error.points();
    const double from_s = study::rests_from_s(joint.q_ref.points());
    std::erase_if(error, [&](const study::Point& point) { return point.x < from_s; });
    run.decay.push_back(fit_decay(error));
  }
  run.summary = log.summary();
  study::Yardsticks yardsticks = study::yardsticks(run.scenario);
  study::add_loop(yardsticks, run.scenario);
  // A log does not hold the table of a reference.
  if (!std::holds_alternative<reference::trajectory::MotionFile>(run.scenario.reference) &&
      std::ranges::count(controller::law_names(), run.scenario.controller.law) > 0) {
    yardsticks.stiffness = certify::stiffness(run.scenario);
  }
  for (const Stretches& ticks : run.saturated) {
    yardsticks.saturated_share.push_back(run.share_of(ticks));
  }
  run.verdict = judge(run.tracking, yardsticks);
  if (const plant::Spec& plant = run.scenario.plant; plant.dry_run || plant.zero_torque) {
    run.verdict = {};
    run.verdict.reason = plant.dry_run ? "a dry run, the robot was sent nothing"
                                       : "the robot was sent zero torques (plant.zero_torque)";
  }
  run.outcome = read_outcome(run);
  if (std::string reason = run.summary.stop_reason(run.info.num_ticks); !reason.empty()) {
    run.verdict.outcome = study::Outcome::stopped;
    run.verdict.reason = std::move(reason);
  }
  run.damage = log.damage();
  return run;
}

void label(std::vector<RecordedRun>& runs) {
  const auto names_of = [](const RecordedRun& run) -> std::array<std::string, 6> {
    const std::string directory = run.log.parent_path().filename().string();
    const std::string law = run.scenario.controller.law_text();
    return {run.scenario.name,
            law,
            fmt::format("{}, {}", run.scenario.name, law),
            directory.empty() ? run.log.filename().string() : directory,
            run.log.string(),
            fmt::format("{}, run {}", run.log.string(), run.run_id)};
  };
  std::set<std::string> different;
  for (std::size_t name = 0; name < 6 && different.size() != runs.size(); ++name) {
    different.clear();
    for (std::size_t i = 0; i < runs.size(); ++i) {
      runs[i].number = i;
      runs[i].label = names_of(runs[i])[name];
      different.insert(runs[i].label);
    }
  }
}

}  // namespace tachless::report
