#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "app/exit_code.h"
#include "app/latency_histogram.h"
#include "bus/wire.h"

namespace app {

/// Why a message of a subscribed channel was not used, beyond what bus::Rejection says.
enum class Unusable { other_run, not_asked, too_old };
inline constexpr int num_unusable = 3;

/// How many messages were dropped, by reason. Counting allocates nothing.
class RejectionTally {
 public:
  void add(bus::Rejection reason) { ++rejected_.at(static_cast<std::size_t>(reason)); }
  void add(Unusable reason) { ++unusable_.at(static_cast<std::size_t>(reason)); }

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
  std::array<std::int64_t, num_unusable> unusable_{};
};

/// What one process has to tell of its part in a run.
struct Statistics {
  struct Log {
    std::string path;
    std::int64_t events = 0;
    std::int64_t ticks = 0;  ///< recorded without a gap
    std::int64_t gaps = 0;   ///< ticks that are missing between recorded ones
  };

  bus::Role role = bus::Role::plant;
  ExitCode exit_code = ExitCode::done;
  std::optional<std::string> fault;
  std::int64_t run_id = 0;
  std::int64_t ticks = 0;
  double wall_s = 0;            ///< from the start of the run to its end
  LatencyHistogram round_trip;  ///< plant: from the first question to the command
  LatencyHistogram work;        ///< own work per tick: plant's step, law's step, reference, writing
  std::int64_t resends = 0;     ///< messages sent again
  std::int64_t duplicates = 0;  ///< messages received again
  RejectionTally rejected;
  std::int64_t missed_deadlines = 0;          ///< realtime plant only
  std::int64_t longest_miss = 0;              ///< realtime plant only: missed in a row [ticks]
  std::vector<std::int64_t> saturated_ticks;  ///< plant: per joint
  std::optional<Log> log;                     ///< logger only
};

/// As JSON: `role exit_code fault run_id ticks wall_s`, `round_trip_us` and `work_us {p50, p99,
/// p999, max, histogram [[from_us, count]…]}`, `resends duplicates rejected {reason: count}
/// missed_deadlines longest_miss saturated_ticks log {path, events, ticks, gaps}`.
std::string to_json(const Statistics& statistics);

/// @throw Failure(bad_usage) naming the path when it cannot be written.
void write_statistics(const Statistics& statistics, const std::filesystem::path& path);

}  // namespace app
