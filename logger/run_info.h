#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "experiment/scenario.h"
#include "logger/log_file.h"
#include "loop/messages.h"

/// Finds the RUN_INFO that explains a log. Reads none of the run's ticks.
namespace tachless::logger {

/// A run that a log holds, and what its RUN_INFO says.
struct RunDescription {
  std::int64_t run = 0;
  loop::RunInfo info;
  experiment::Scenario scenario;
  loop::Layout layout;  ///< `num_signals` is how many signals RUN_INFO declares
};

inline constexpr std::string_view run_info_suffix = "_RUN_INFO";

/// Reads `reader` from where it stands up to a RUN_INFO, wherever it is; of that run, if `wanted`.
/// One that no message of the robot and run goes with counts only when there is no other.
/// @throw diagnostics::Failure(bad_usage) when the log holds no usable RUN_INFO (of that run):
/// damaged, recorded by a version whose messages were others, or with a scenario that is not valid.
RunDescription find_run(LogReader& reader, std::optional<std::int64_t> wanted);

}  // namespace tachless::logger
