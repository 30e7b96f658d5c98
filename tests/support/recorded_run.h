#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "logger/run_log.h"
#include "messages/wire.h"
#include "scenario/scenario.h"

/// Logs in the form of the logger, with random numbers: every value of every quantity is any
/// double, the same for the same seed.
namespace tachless::logger {

struct Recorded {
  std::int64_t utime = 0;
  std::string channel;
  std::string data;
};

struct RecordedRun {
  scenario::Scenario scenario;
  messages::RunInfo info;
  std::int64_t run = 0;
  std::int64_t stop_tick = 17;  ///< of `fault_message`
  std::vector<TickRecord> ticks;
  std::vector<Recorded> messages;  ///< RUN_INFO, then six per tick in canonical order

  /// Returns the log of `messages`.
  [[nodiscard]] std::string bytes() const;
};

/// Signals that the laws of rigid robots log.
inline constexpr const char* rigid_signals = "error:rad,nu:rad/s";

/// @param scenario a file of scenarios/
/// @param overrides in the form of --set
/// @param signals of the law, as in RUN_INFO
RecordedRun recorded_run(const std::string& scenario, const std::vector<std::string>& overrides,
                         const std::string& measurement, const std::string& signals = rigid_signals,
                         std::int64_t run = 7, std::uint64_t seed = 1);

/// Returns 40 ticks of paper_rigid.
RecordedRun short_rigid_run(std::int64_t run = 7);
/// Returns 40 ticks of paper_rigid in realtime. If `told` is set, an arm tells these torques: k and
/// k + 1/2 in tick k.
RecordedRun short_arm_run(std::optional<messages::truth::Told> told);
/// Returns 40 ticks of paper_flexible.
RecordedRun short_flexible_run();

Recorded fault_message(const RecordedRun& run, const std::string& text);
/// The plant's announcement that the run has reached its planned end.
Recorded finished_message(const RecordedRun& run);

std::string log_of(const std::vector<Recorded>& messages);

}  // namespace tachless::logger
