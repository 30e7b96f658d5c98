#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/failure.h"
#include "messages/messages.h"
#include "messages/wire.h"

/// Counters of each of the four programs during a run, and their file (--stats). This header both
/// writes and reads the file, so that its keys stand in one place. The counters do not influence
/// the loop.
namespace tachless::session {

/// Histogram of durations in buckets of a fixed relative width: 16 per octave, hence 6 %. It takes
/// constant memory, and `add` allocates nothing. The class knows no unit of the loop and no file.
class LatencyHistogram {
 public:
  struct Bucket {
    double from_us = 0;
    std::int64_t count = 0;
  };

  void add(std::chrono::nanoseconds duration);
  /// Adds a bucket of another histogram's `buckets`.
  void add(const Bucket& bucket);
  void raise_max(double max_us);

  [[nodiscard]] std::int64_t count() const { return count_; }
  [[nodiscard]] double max_us() const { return static_cast<double>(max_ns_) * 1e-3; }

  /// Returns the duration that the given part (0 to 1) of all durations do not exceed, to a
  /// bucket's width [us]. Returns 0 without durations.
  [[nodiscard]] double percentile_us(double part) const;

  /// Returns the buckets that are not empty, in order.
  [[nodiscard]] std::vector<Bucket> buckets() const;

 private:
  static constexpr int per_octave = 16;
  static constexpr int num_buckets = per_octave * 36;  // up to more than a minute in ns
  static std::size_t bucket_of(std::int64_t ns);
  static std::int64_t lower_edge(int bucket);

  std::array<std::int64_t, num_buckets> counts_{};
  std::int64_t count_ = 0;
  std::int64_t max_ns_ = 0;
};

/// Reason for which a message of a subscribed channel was not used, beyond messages::Rejection.
enum class Discard { other_run, not_asked, too_old, other_sender, unauthenticated };

/// Numbers of dropped messages by reason. Counting allocates nothing.
class RejectionTally {
 public:
  void add(messages::Rejection reason) { ++counts_.at(static_cast<std::size_t>(reason) - 1); }
  void add(Discard reason, std::int64_t count = 1) {
    counts_.at(num_rejections + static_cast<std::size_t>(reason)) += count;
  }
  /// Adds to the reason of this name; ignores an unknown name.
  void add(std::string_view reason, std::int64_t count);

  struct Entry {
    std::string_view reason;
    std::int64_t count = 0;
  };
  /// Returns the counts of all reasons, zeros included.
  [[nodiscard]] std::vector<Entry> entries() const;
  [[nodiscard]] std::int64_t total() const;

 private:
  static constexpr std::size_t num_rejections =
      static_cast<std::size_t>(messages::Rejection::bad_value);
  static constexpr std::size_t num_discards = 5;
  static std::string_view reason(std::size_t index);

  std::array<std::int64_t, num_rejections + num_discards> counts_{};  ///< `none` is not counted
};

struct PlantStatistics {
  LatencyHistogram round_trip_us;  ///< lockstep: from a tick's first request to its command
  /// Realtime: delay of a tick's work after its deadline; time from the measurement to its command.
  LatencyHistogram wake_up_jitter_us, command_age_us;
  /// Realtime: ticks whose work began more than a period late; greatest number of consecutive ones.
  /// With a robot that is the clock and reports its time: ticks that passed without an answer.
  std::int64_t missed_deadlines = 0, longest_miss = 0;
  /// Realtime: ticks that ended without their command; greatest number of consecutive ones;
  /// commands that came after their tick.
  std::int64_t missed_commands = 0, longest_command_miss = 0, late_commands = 0;
  /// Realtime: ticks in which a real robot gave no state; greatest number of consecutive ones.
  std::int64_t missed_readings = 0, longest_reading_miss = 0;
  std::vector<std::int64_t> saturated_ticks;  ///< ticks at a torque limit, per joint
  /// Per joint: ticks outside its range or above its speed limit, with plant.on_limit: warn.
  std::vector<std::int64_t> beyond_limit_ticks;
  bool robot_is_clock = false;           ///< the robot begins the ticks
  std::map<std::string, double> driver;  ///< a driver's own figures, by their names
};

struct ReferenceStatistics {};

struct ControllerStatistics {
  /// Realtime: number of gaps, skipped ticks, and restarts of the law's memory after gaps too long
  /// for it.
  std::int64_t gaps = 0, skipped_ticks = 0, restarts = 0;
};

struct LoggerStatistics {
  struct Log {
    std::string path;
    std::int64_t events = 0;
    std::int64_t ticks = 0;  ///< recorded without a gap
    std::int64_t gaps = 0;   ///< ticks missing between recorded ones
  };
  Log log;
};

/// Statistics of a program: the common counters, and in `own` the counters of its role.
struct Statistics {
  explicit Statistics(messages::Role own_role = messages::Role::plant) : role(own_role) {
    if (role == messages::Role::reference) own.emplace<ReferenceStatistics>();
    if (role == messages::Role::controller) own.emplace<ControllerStatistics>();
    if (role == messages::Role::logger) own.emplace<LoggerStatistics>();
  }

  messages::Role role;
  base::ExitCode exit_code = base::ExitCode::done;
  std::optional<std::string> fault;
  std::int64_t run_id = 0;
  std::int64_t ticks = 0;
  double wall_s = 0;  ///< time from the start of the run to its end
  /// Own work per tick: the plant's step, the law's step, computing a reference, or writing.
  LatencyHistogram work_us;
  std::int64_t resends = 0;     ///< messages sent again
  std::int64_t duplicates = 0;  ///< messages received again
  RejectionTally rejected;
  std::variant<PlantStatistics, ReferenceStatistics, ControllerStatistics, LoggerStatistics> own;

  /// @throw std::bad_variant_access for another role
  PlantStatistics& plant() { return std::get<PlantStatistics>(own); }
  ControllerStatistics& controller() { return std::get<ControllerStatistics>(own); }
  LoggerStatistics& logger() { return std::get<LoggerStatistics>(own); }
  [[nodiscard]] const PlantStatistics& plant() const { return std::get<PlantStatistics>(own); }
  [[nodiscard]] const ControllerStatistics& controller() const {
    return std::get<ControllerStatistics>(own);
  }
  [[nodiscard]] const LoggerStatistics& logger() const { return std::get<LoggerStatistics>(own); }
};

/// Writes {p50, p99, p999, max, histogram [[from_us, count]…]} in microseconds.
void to_json(nlohmann::ordered_json& json, const LatencyHistogram& histogram);
/// Returns one JSON object: the common fields, then the role's fields, with the names above.
std::string to_json(const Statistics& statistics);
/// Returns the statistics in a text of `to_json`.
/// @throw std::invalid_argument for another text
Statistics statistics_from_json(const std::string& text);

/// Writes the statistics as JSON to a file.
/// @throw Failure(bad_usage) naming the path if it cannot be written.
void write_statistics(const Statistics& statistics, const std::filesystem::path& path);

}  // namespace tachless::session
