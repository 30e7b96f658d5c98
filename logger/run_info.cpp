#include "logger/run_info.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "bus/wire.h"
#include "diagnostics/failure.h"
#include "diagnostics/text.h"
#include "diagnostics/version.h"
#include "loop/measurements.h"

namespace tachless::logger {
namespace {

/// Versions whose messages were others, by the fingerprint of their RUN_INFO.
struct OldVersion {
  std::int64_t run_info;
  std::string_view version;
};
constexpr std::array old_versions = {OldVersion{0x2243251c415912ef, "0.1.0"}};

/// Nothing when the scenario, the description and the channel agree; else what
/// is wrong.
std::string contradiction(const RunDescription& found, std::string_view prefix) {
  const auto& [run, info, scenario, layout] = found;
  if (info.robot != prefix || scenario.robot.channel_prefix != prefix) {
    return fmt::format("names robot {} on channel {}{}", info.robot, prefix, run_info_suffix);
  }
  if (info.num_ticks != scenario.loop.num_ticks || info.period_s != scenario.loop.period_s) {
    return "contradicts the scenario in it on the number or the length of ticks";
  }
  if (std::ranges::find(loop::measurement_suffixes, info.measurement) ==
      loop::measurement_suffixes.end()) {
    return "names an unknown measurement, " + info.measurement;
  }
  if (!loop::parse_signals(info.signals)) {
    return fmt::format("declares the law's signals as \"{}\", which is not name:unit,...",
                       info.signals);
  }
  return {};
}

/// Reads one RUN_INFO. Returns what is wrong with it, or nothing and `found`.
std::string read(const LogEvent& event, const std::filesystem::path& path,
                 std::optional<std::int64_t> wanted, RunDescription& found) {
  const bus::Codec<loop::RunInfo> codec(loop::Layout{});
  loop::Stamp stamp;
  const auto rejection = codec.decode(event.data, stamp, found.info);
  if (rejection != bus::Rejection::none) {
    return fmt::format("is damaged ({})", bus::name(rejection));
  }
  if (wanted && stamp.run != *wanted) {
    return fmt::format("is of run {}, not of run {}", stamp.run, *wanted);
  }
  found.run = stamp.run;
  try {
    found.scenario = experiment::parse_scenario(found.info.scenario, found.info.robot_description,
                                                path.string() + " (RUN_INFO)");
  } catch (const diagnostics::Failure& failure) {
    return fmt::format("cannot be used: {}", failure.what());
  }
  if (found.scenario.controller.law == experiment::external_law) {
    found.scenario.controller.announced = diagnostics::printable(found.info.law);
  }
  const std::string prefix(event.channel.substr(0, event.channel.size() - run_info_suffix.size()));
  std::string problem = contradiction(found, prefix);
  if (problem.empty()) {
    found.layout =
        loop::layout(found.scenario.num_joints, found.scenario.robot.flexible.has_value(),
                     static_cast<int>(loop::parse_signals(found.info.signals)->size()));
  }
  return problem;
}

/// Whether the log holds any message of this robot and run but RUN_INFO.
bool has_messages(const std::filesystem::path& path, const RunDescription& run) {
  LogReader reader(path);
  while (const auto event = reader.next()) {
    if (event->channel.starts_with(run.info.robot + "_") && event->data.size() >= bus::stamp_end &&
        !event->channel.ends_with(run_info_suffix) && bus::stamp_of(event->data).run == run.run) {
      return true;
    }
  }
  return false;
}

}  // namespace

RunDescription find_run(LogReader& reader, std::optional<std::int64_t> wanted) {
  std::string problem;
  std::uint64_t events = 0;
  std::optional<RunDescription> alone;
  while (const auto event = reader.next()) {
    ++events;
    if (!event->channel.ends_with(run_info_suffix)) continue;
    const auto fingerprint = bus::fingerprint_of(event->data);
    const auto old = std::ranges::find_if(
        old_versions, [&](const OldVersion& each) { return each.run_info == fingerprint; });
    if (old != old_versions.end()) {
      if (problem.empty()) {
        problem = fmt::format(
            "was recorded by tachless {0}; this is {1}, which reads logs of {1}; use {0} to read "
            "it",
            old->version, diagnostics::version);
      }
      continue;
    }
    RunDescription found;
    const std::string wrong = read(*event, reader.path(), wanted, found);
    if (!wrong.empty()) {
      if (problem.empty()) {
        problem = fmt::format("its RUN_INFO at byte {} {}", event->offset, wrong);
      }
      continue;
    }
    if (has_messages(reader.path(), found)) return found;
    // A run nobody else took part in; its id may be damaged. Is there a better
    // one?
    if (!alone) alone = std::move(found);
  }
  if (alone) return std::move(*alone);
  if (problem.empty()) {
    problem = fmt::format(
        "none of its {} messages is a RUN_INFO, which says what was run; record from before the "
        "start on, or see what the log holds with: tachless info {}",
        events, reader.path().string());
  }
  throw diagnostics::bad_usage("{}: {}", reader.path().string(), problem);
}

}  // namespace tachless::logger
