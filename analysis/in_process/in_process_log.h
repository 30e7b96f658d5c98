#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string_view>

#include "in_process/in_process_loop.h"

namespace tachless::in_process {

/// A message of a run as a log holds it. The views are valid during the call that receives them.
struct LogMessage {
  std::int64_t utime = 0;  ///< [us]
  std::string_view channel;
  std::span<const std::byte> data;
};

/// Steps the loop in this process and passes each message of a lockstep run to `write`. The
/// messages are RUN_INFO, then the messages of each tick in their logged order. A lockstep run of
/// the scenario logs the same bytes. The call writes no file.
/// @param on_tick receives the tick's record after the tick's messages; false ends the run
/// @throw base::Failure as `run_in_process` does, and (bad_usage) when RUN_INFO is too long
void log_in_process(const scenario::Scenario& scenario, controller::ScenarioLaw law,
                    std::int64_t run, const std::function<void(const LogMessage&)>& write,
                    const std::function<bool(const TickRecord&)>& on_tick);

}  // namespace tachless::in_process
