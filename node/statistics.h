#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "bus/wire.h"
#include "diagnostics/failure.h"
#include "node/latency_histogram.h"

namespace tachless::node {

/// Why a message of a subscribed channel was not used, beyond what bus::Rejection says.
enum class Discard { other_run, not_asked, too_old, unauthenticated };
inline constexpr int num_discards = 4;

/// How many messages were dropped, by reason. Counting allocates nothing.
class RejectionTally {
 public:
  void add(bus::Rejection reason) { ++rejected_.at(static_cast<std::size_t>(reason)); }
  void add(Discard reason, std::int64_t count = 1) {
    discarded_.at(static_cast<std::size_t>(reason)) += count;
  }

  struct Entry {
    std::string_view reason;
    std::int64_t count = 0;
  };
  /// Every reason, those that never occurred too.
  [[nodiscard]] std::vector<Entry> entries() const;
  [[nodiscard]] std::int64_t total() const;

 private:
  static constexpr int num_rejections = static_cast<int>(bus::Rejection::bad_value) + 1;
  std::array<std::int64_t, num_rejections> rejected_{};
  std::array<std::int64_t, num_discards> discarded_{};
};

/// What one process has to tell of its part in a run.
struct Statistics {
  struct Log {
    std::string path;
    std::int64_t events = 0;
    std::int64_t ticks = 0;  ///< recorded without a gap
    std::int64_t gaps = 0;   ///< ticks that are missing between recorded ones
  };

  loop::Role role = loop::Role::plant;
  diagnostics::ExitCode exit_code = diagnostics::ExitCode::done;
  std::optional<std::string> fault;
  std::int64_t run_id = 0;
  std::int64_t ticks = 0;
  double wall_s = 0;            ///< from the start of the run to its end
  LatencyHistogram round_trip;  ///< plant: from the first question to the command
  LatencyHistogram work;        ///< own work per tick: plant's step, law's step, reference, writing
  std::int64_t resends = 0;     ///< messages sent again
  std::int64_t duplicates = 0;  ///< messages received again
  RejectionTally rejected;
  /// Realtime plant only: ticks whose work began more than a period late, and most in a row.
  std::int64_t missed_deadlines = 0;
  std::int64_t longest_miss = 0;
  /// Realtime plant only: ticks that ended without their command, most in a row, and commands that
  /// came after their tick.
  std::int64_t missed_commands = 0;
  std::int64_t longest_command_miss = 0;
  std::int64_t late_commands = 0;
  LatencyHistogram wake_up_jitter;  ///< realtime plant: from a tick's deadline to its work's begin
  LatencyHistogram command_age;     ///< realtime plant: from the measurement to its command
  /// Realtime controller: times that ticks were passed over, the ticks passed over, and times that
  /// there were too many for the law's memory, which then began anew.
  std::int64_t gaps = 0;
  std::int64_t skipped_ticks = 0;
  std::int64_t restarts = 0;
  /// Lockstep plant: times that another controller has taken the place of one that died.
  std::int64_t takeovers = 0;
  std::vector<std::int64_t> saturated_ticks;  ///< plant: per joint
  std::optional<Log> log;                     ///< logger only
};

/// As JSON: `role exit_code fault run_id ticks wall_s`, `round_trip_us`, `work_us`,
/// `wake_up_jitter_us` and `command_age_us {p50, p99, p999, max, histogram [[from_us, count]…]}`,
/// `resends duplicates rejected {reason: count} missed_deadlines longest_miss missed_commands
/// longest_command_miss late_commands gaps skipped_ticks restarts takeovers saturated_ticks
/// log {path, events, ticks, gaps}`.
std::string to_json(const Statistics& statistics);

/// @throw Failure(bad_usage) naming the path when it cannot be written.
void write_statistics(const Statistics& statistics, const std::filesystem::path& path);

}  // namespace tachless::node
