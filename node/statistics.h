#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "bus/wire.h"
#include "diagnostics/failure.h"
#include "node/latency_histogram.h"

/// What each of the four programs counts during a run, and its file (--stats): written and read
/// here, so that nobody else knows the keys. The counters mean nothing for the loop itself.
namespace tachless::node {

/// Why a message of a subscribed channel was not used, beyond what bus::Rejection says.
enum class Discard { other_run, not_asked, too_old, other_sender, unauthenticated };
inline constexpr int num_discards = 5;

/// How many messages were dropped, by reason. Counting allocates nothing.
class RejectionTally {
 public:
  void add(bus::Rejection reason) { ++rejected_.at(static_cast<std::size_t>(reason)); }
  void add(Discard reason, std::int64_t count = 1) {
    discarded_.at(static_cast<std::size_t>(reason)) += count;
  }
  /// Nothing when there is no such reason.
  void add(std::string_view reason, std::int64_t count);

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

struct PlantStatistics {
  LatencyHistogram round_trip_us;  ///< lockstep: from a tick's first question to its command
  /// Realtime: from a tick's deadline to the begin of its work, from the measurement to its
  /// command.
  LatencyHistogram wake_up_jitter_us, command_age_us;
  /// Realtime: ticks whose work began more than a period late, and most in a row.
  std::int64_t missed_deadlines = 0, longest_miss = 0;
  /// Realtime: ticks that ended without their command, most in a row, and commands that came after
  /// their tick.
  std::int64_t missed_commands = 0, longest_command_miss = 0, late_commands = 0;
  std::int64_t takeovers = 0;                 ///< lockstep: controllers that replaced one that died
  std::vector<std::int64_t> saturated_ticks;  ///< per joint
  /// Per joint: ticks outside of its range or faster than its limit, with plant.on_limit: warn.
  std::vector<std::int64_t> beyond_limit_ticks;
};

struct ReferenceStatistics {};

struct ControllerStatistics {
  /// Realtime: times that ticks were skipped, the ticks skipped, and times that there were too many
  /// for the law's memory, which then started again.
  std::int64_t gaps = 0, skipped_ticks = 0, restarts = 0;
};

struct LoggerStatistics {
  struct Log {
    std::string path;
    std::int64_t events = 0;
    std::int64_t ticks = 0;  ///< recorded without a gap
    std::int64_t gaps = 0;   ///< ticks that are missing between recorded ones
  };
  Log log;
};

/// Head: what every program counts; `own`: what its role counts besides.
struct Statistics {
  explicit Statistics(loop::Role role = loop::Role::plant);

  loop::Role role;
  diagnostics::ExitCode exit_code = diagnostics::ExitCode::done;
  std::optional<std::string> fault;
  std::int64_t run_id = 0;
  std::int64_t ticks = 0;
  double wall_s = 0;            ///< from the start of the run to its end
  LatencyHistogram work_us;     ///< own work per tick: plant's step, law's step, reference, writing
  std::int64_t resends = 0;     ///< messages sent again
  std::int64_t duplicates = 0;  ///< messages received again
  RejectionTally rejected;
  std::variant<PlantStatistics, ReferenceStatistics, ControllerStatistics, LoggerStatistics> own;

  /// @throw std::bad_variant_access for another role's
  PlantStatistics& plant() { return std::get<PlantStatistics>(own); }
  ControllerStatistics& controller() { return std::get<ControllerStatistics>(own); }
  LoggerStatistics& logger() { return std::get<LoggerStatistics>(own); }
  [[nodiscard]] const PlantStatistics& plant() const { return std::get<PlantStatistics>(own); }
  [[nodiscard]] const ControllerStatistics& controller() const {
    return std::get<ControllerStatistics>(own);
  }
  [[nodiscard]] const LoggerStatistics& logger() const { return std::get<LoggerStatistics>(own); }
};

/// {p50, p99, p999, max, histogram [[from_us, count]…]} in microseconds.
void to_json(nlohmann::ordered_json& json, const LatencyHistogram& histogram);
/// One JSON object: the head's fields, then the role's, named as above.
std::string to_json(const Statistics& statistics);
/// The inverse. @throw std::invalid_argument when it is not that
Statistics statistics_from_json(const std::string& text);

/// @throw Failure(bad_usage) naming the path when it cannot be written.
void write_statistics(const Statistics& statistics, const std::filesystem::path& path);

}  // namespace tachless::node
