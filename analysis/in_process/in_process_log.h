#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string_view>

#include "in_process/in_process_loop.h"

namespace tachless::in_process {

/// A message of a run, as a log holds it. Valid during the call that gets it.
struct LogMessage {
  std::int64_t utime = 0;  ///< [us]
  std::string_view channel;
  std::span<const std::byte> data;
};

/// Steps the loop in this process and gives `write` what a lockstep run of the scenario logs, to
/// the last bit: RUN_INFO, then six messages per tick in their order. Writes no file.
/// @param on_tick as of `run_in_process`, after the tick's messages
/// @throw base::Failure as `run_in_process`, and (bad_usage) when RUN_INFO is too long
void log_in_process(const scenario::Scenario& scenario, controller::ScenarioLaw law,
                    std::int64_t run, const std::function<void(const LogMessage&)>& write,
                    const std::function<bool(const TickRecord&)>& on_tick);

}  // namespace tachless::in_process
