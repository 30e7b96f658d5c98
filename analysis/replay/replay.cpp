#include "replay/replay.h"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <type_traits>
#include <utility>
#include <variant>

#include "base/failure.h"
#include "base/text.h"
#include "scenario/gains.h"

namespace tachless::replay {
namespace {

template <class... Args>
[[noreturn]] void refuse(const logger::RunLog& log, fmt::format_string<Args...> problem,
                         Args&&... args) {
  throw base::bad_usage("{}: {}", log.path().string(),
                        fmt::format(problem, std::forward<Args>(args)...));
}

/// Returns the measurement with the suffix `wanted` from the measurement `had`. A full state
/// contains the smaller measurements. Returns nothing when `had` is empty or does not contain it.
std::optional<messages::AnyMeasurement> measured(const std::optional<messages::AnyMeasurement>& had,
                                                 std::string_view wanted) {
  std::optional<messages::AnyMeasurement> result;
  messages::with_measurement(wanted, [&]<class Wanted>(std::type_identity<Wanted> /*type*/) {
    if (!had) return;
    std::visit(
        [&]<class Had>(const Had& all) {
          if constexpr (messages::is_part_of<Wanted, Had>())
            result = messages::part_of<Wanted>(all);
        },
        *had);
  });
  return result;
}

void require_fitting(const logger::RunLog& log, const scenario::Scenario& scenario) {
  const scenario::Scenario& recorded = log.scenario();
  if (scenario.num_joints != recorded.num_joints) {
    refuse(log, "recorded with {} joints, not {}; robot.urdf must stay so", recorded.num_joints,
           scenario.num_joints);
  }
  if (scenario.loop.period_s != recorded.loop.period_s) {
    refuse(log, "recorded with loop.period_s {}, not {}; loop.period_s must stay so",
           base::shortest(recorded.loop.period_s), base::shortest(scenario.loop.period_s));
  }
  if (scenario.robot.flexible.has_value() != recorded.robot.flexible.has_value()) {
    refuse(log, "recorded from a robot whose joints are {}; robot.joints must stay so",
           recorded.robot.flexible ? "flexible" : "rigid");
  }
}

void require_measured(const logger::RunLog& log, const messages::LawInfo& law) {
  if (measured(messages::measurement_of(log.info().measurement), law.measurement)) return;
  refuse(
      log,
      "law {} needs the measurement {}, which the recorded {} does not contain; replay a law that "
      "measures less",
      law.law, law.measurement, log.info().measurement);
}

/// The state of a replay in progress.
struct Progress {
  const OnCompared& on_compared;
  Replay result;
  /// Counts since the last command. Ticks without a command are gaps only when a command follows.
  std::uint64_t pending = 0, pending_passed_over = 0;
  std::int64_t first_pending = -1;

  Progress(int num_joints, const OnCompared& told) : on_compared(told) {
    result.joints.resize(static_cast<std::size_t>(num_joints));
  }

  void add(std::int64_t tick, const Vector& recorded, const Vector& replayed) {
    if (pending != 0 && result.first_without_command < 0) {
      result.first_without_command = first_pending;
    }
    result.without_command += std::exchange(pending, 0);
    result.passed_over += std::exchange(pending_passed_over, 0);
    bool same = true;
    for (int i = 0; i < static_cast<int>(recorded.size()); ++i) {
      const std::uint64_t ulps = ulps_between(recorded[i], replayed[i]);
      same = same && ulps == 0;
      if (ulps != 0 && !result.first) result.first = {tick, i, recorded[i], replayed[i], ulps};
      auto& joint = result.joints[static_cast<std::size_t>(i)];
      const double difference = replayed[i] - recorded[i];
      if (std::abs(difference) > joint.difference.peak() || joint.peak_tick < 0) {
        joint.peak_tick = tick;
      }
      joint.difference.add(difference);
      joint.recorded.add(recorded[i]);
      joint.replayed.add(replayed[i]);
    }
    ++result.compared;
    if (!same) ++result.different;
    result.last_compared = tick;
    if (on_compared) on_compared(tick, recorded, replayed);
  }
};

/// Returns whether any tick from the one in `record` on has a command.
bool command_follows(logger::RunLog& log, logger::TickRecord& record) {
  do {
    if (record.command) return true;
  } while (log.next(record));
  return false;
}

/// Returns whether the replay ignores the gains in the log's references. It does so with another
/// law, with other gains, and with gains that may not change.
bool changes_gains(const scenario::Scenario& recorded, const scenario::Scenario& scenario) {
  return scenario.controller.law != recorded.controller.law ||
         !scenario.controller.gains_may_change ||
         scenario::gains_text(scenario.controller.gains) !=
             scenario::gains_text(recorded.controller.gains);
}

/// Steps `law` through the log and compares its commands.
void step_through(logger::RunLog& log, const scenario::Scenario& scenario, controller::AnyLaw& law,
                  Progress& comparison) {
  const bool realtime = scenario.loop.mode == scenario::Mode::realtime;
  Replay& result = comparison.result;
  const bool own_gains = changes_gains(log.scenario(), scenario);
  logger::TickRecord record;
  std::int64_t next = 0;
  while (result.stopped_by.empty() && log.next(record)) {
    if (own_gains && record.reference) record.reference->gains.clear();
    if (record.contact) result.simulator = record.contact->simulator;
    if (realtime && !record.command && !record.controller_state) {
      ++comparison.pending_passed_over;
      continue;
    }
    const auto measurement = measured(record.measurement, law.measurement());
    // In lockstep every tick counts. In realtime only the ticks count on which the controller
    // acted.
    const bool jump = !realtime && record.tick != next;
    if (jump || !measurement || !record.reference) {
      const auto lacking =
          jump || !measurement ? messages::Slot::measurement : messages::Slot::reference;
      const std::string gap = fmt::format("tick {} has no {}", jump ? next : record.tick,
                                          log.summary().of(lacking).channel);
      // A run that was ended between two messages leaves no gap at its end.
      if (command_follows(log, record)) result.stopped_by = gap;
      break;
    }
    next = record.tick + 1;
    Vector tau;
    try {
      tau = law.step(record.tick, *measurement, *record.reference).command.tau;
    } catch (const base::Failure& failure) {
      if (failure.code() != base::ExitCode::protective_stop) throw;
      result.not_finite = true;
      result.stopped_by = failure.what();
      break;
    } catch (const std::logic_error& error) {
      // Damaged numbers can be anything, for example postures without an inertia matrix.
      result.stopped_by =
          fmt::format("the law cannot be evaluated at tick {}: {}", record.tick, error.what());
      break;
    }
    if (record.command) {
      comparison.add(record.tick, record.command->tau, tau);
    } else if (comparison.pending++ == 0) {
      comparison.first_pending = record.tick;
    }
  }
  // The rest of the log is read to count its lost messages.
  while (log.next(record)) {
  }
}

}  // namespace

std::uint64_t ulps_between(double a, double b) {
  // Maps doubles to integers of the same order. The bits of negative doubles are in reverse order.
  const auto place = [](double x) {
    const auto bits = std::bit_cast<std::uint64_t>(x);
    constexpr std::uint64_t sign = std::uint64_t{1} << 63;
    return (bits & sign) != 0 ? ~bits : bits | sign;
  };
  const std::uint64_t from = place(a), to = place(b);
  return from < to ? to - from : from - to;
}

Replay replay(logger::RunLog& log, const scenario::Scenario& scenario, controller::ScenarioLaw law,
              const OnCompared& on_compared) {
  require_fitting(log, scenario);
  require_measured(log, controller::law_info(*law));
  log.rewind();
  Progress comparison(scenario.num_joints, on_compared);
  step_through(log, scenario, *law, comparison);
  return std::move(comparison.result);
}

std::string hindrance(const Replay& replay, const logger::RunLog& log) {
  if (!replay.stopped_by.empty()) {
    return fmt::format(
        "cannot verify beyond {}: {}",
        replay.compared > 0 ? fmt::format("tick {}", replay.last_compared) : "the start",
        replay.stopped_by);
  }
  if (replay.without_command != 0) {
    return fmt::format("{} ticks cannot be verified, the first is {}: they have no {}",
                       replay.without_command, replay.first_without_command,
                       log.summary().of(messages::Slot::command).channel);
  }
  return replay.compared == 0 ? "there is no tick whose command could be verified" : "";
}

std::string problem_text(const Replay& replay, const logger::RunLog& log,
                         const robot::JointLabels& joints) {
  const std::string gap = hindrance(replay, log);
  if (replay.different == 0) {
    if (gap.empty()) return "";
    return fmt::format("{}: {}; the {} commands verified are the same", log.path().string(), gap,
                       replay.compared);
  }
  const Mismatch& first = *replay.first;
  const std::string& unit = joints.effort[static_cast<std::size_t>(first.joint)];
  return fmt::format(
      "{}: {} of {} commands differ, first at tick {} ({:.9g} s), {}: recorded {:.17g} {}, "
      "replayed {:.17g} {}, {} ulp{} or {:.3g} {} apart{}{}",
      log.path().string(), replay.different, replay.compared, first.tick,
      static_cast<double>(first.tick) * log.info().period_s,
      joints.joint(static_cast<std::size_t>(first.joint)), first.recorded, unit, first.replayed,
      unit, first.ulps, first.ulps == 1 ? "" : "s", first.replayed - first.recorded, unit,
      gap.empty() ? "" : "; ", gap);
}

std::string verified_text(const Replay& replay, const logger::RunLog& log, double wall_s) {
  const double recorded_s = static_cast<double>(replay.compared) * log.info().period_s;
  const std::string plant =
      replay.simulator.empty() ? "" : ", plant " + base::printable(replay.simulator);
  std::string text =
      fmt::format("{}: run {}, law {}{}\nthe same: {} commands, bit for bit", log.path().string(),
                  log.run(), log.scenario().controller.law_text(), plant, replay.compared);
  if (replay.passed_over != 0) {
    text +=
        fmt::format("; {} ticks have none, the controller passed them over", replay.passed_over);
  }
  if (log.summary().last_tick + 1 != log.info().num_ticks) {
    text += fmt::format(" (the run ended early: it was to have {} ticks)", log.info().num_ticks);
  }
  return text + fmt::format("\n{:.4g} s of the robot's time in {:.3g} s: {:.4g} times as fast\n",
                            recorded_s, wall_s, recorded_s / wall_s);
}

std::string damage_text(const logger::RunLog& log) {
  if (!log.damage().any()) return "";
  return fmt::format("{} is damaged: {}; see tachless info", log.path().string(),
                     log.damage().text());
}

nlohmann::ordered_json to_json(const Replay& replay) {
  using Json = nlohmann::ordered_json;
  Json joints = Json::array(), first;
  for (const JointTorques& joint : replay.joints) {
    if (replay.compared == 0) break;
    joints.push_back({{"max_Nm", joint.difference.peak()},
                      {"max_tick", joint.peak_tick},
                      {"rms_Nm", joint.difference.rms()},
                      {"recorded_peak_Nm", joint.recorded.peak()},
                      {"replayed_peak_Nm", joint.replayed.peak()}});
  }
  if (const auto& at = replay.first) {
    first = {{"tick", at->tick},
             {"joint", at->joint + 1},
             {"recorded_Nm", at->recorded},
             {"replayed_Nm", at->replayed},
             {"difference_Nm", at->replayed - at->recorded},
             {"ulps", at->ulps}};
  }
  return {
      {"compared_ticks", replay.compared},
      {"different_ticks", replay.different},
      {"last_compared_tick", replay.compared > 0 ? Json(replay.last_compared) : Json()},
      {"complete", replay.complete()},
      {"ticks_without_command", replay.without_command},
      {"ticks_passed_over", replay.passed_over},
      {"simulator", replay.simulator.empty() ? Json() : Json(base::printable(replay.simulator))},
      {"stopped_by", replay.stopped_by.empty() ? Json() : Json(replay.stopped_by)},
      {"first_difference", first},
      {"joints", joints}};
}

}  // namespace tachless::replay
