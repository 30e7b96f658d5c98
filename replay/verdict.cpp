#include "replay/verdict.h"

#include <fmt/format.h>

namespace tachless::replay {

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
                       log.summary().of(loop::Slot::command).channel);
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
  std::string text =
      fmt::format("{}: run {}, law {}\nthe same: {} commands, bit for bit", log.path().string(),
                  log.run(), log.scenario().controller.law_text(), replay.compared);
  if (replay.passed_over != 0) {
    text +=
        fmt::format("; {} ticks have none, the controller passed them over", replay.passed_over);
  }
  if (log.summary().last_tick + 1 != log.info().num_ticks) {
    text += fmt::format(" (the run ended early: it was to have {} ticks)", log.info().num_ticks);
  }
  return text + fmt::format("\n{:.4g} s of the robot's time in {:.3g} s: {:.0f} times as fast\n",
                            recorded_s, wall_s, recorded_s / wall_s);
}

std::string damage_text(const logger::RunLog& log) {
  if (!log.damage().any()) return "";
  return fmt::format("{} is damaged: {} bytes at {} places are no events; see tachless info",
                     log.path().string(), log.damage().bytes_skipped, log.damage().stretches);
}

}  // namespace tachless::replay
