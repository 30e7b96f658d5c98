#include "session/statistics.h"

#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <stdexcept>

#include "base/file_text.h"
#include "base/json_text.h"

namespace tachless::session {

using Json = nlohmann::ordered_json;

// This is NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE for ordered_json, which that macro supports only from
// 3.12 on.
#define TACHLESS_JSON_FIELDS(Type, ...)                                        \
  static void to_json(Json& nlohmann_json_j, const Type& nlohmann_json_t) {    \
    NLOHMANN_JSON_EXPAND(NLOHMANN_JSON_PASTE(NLOHMANN_JSON_TO, __VA_ARGS__))   \
  }                                                                            \
  static void from_json(const Json& nlohmann_json_j, Type& nlohmann_json_t) {  \
    NLOHMANN_JSON_EXPAND(NLOHMANN_JSON_PASTE(NLOHMANN_JSON_FROM, __VA_ARGS__)) \
  }

void to_json(Json& json, const LatencyHistogram& histogram) {
  Json buckets = Json::array();
  for (const auto& bucket : histogram.buckets()) buckets.push_back({bucket.from_us, bucket.count});
  json = {{"p50", histogram.percentile_us(0.5)},
          {"p99", histogram.percentile_us(0.99)},
          {"p999", histogram.percentile_us(0.999)},
          {"max", histogram.max_us()},
          {"histogram", buckets}};
}

static void from_json(const Json& json, LatencyHistogram& histogram) {
  for (const Json& bucket : json.at("histogram")) {
    histogram.add({bucket.at(0).get<double>(), bucket.at(1).get<std::int64_t>()});
  }
  histogram.raise_max(json.at("max").get<double>());
}

static void to_json(Json& json, const RejectionTally& rejected) {
  json = Json::object();
  for (const auto& entry : rejected.entries()) json[std::string(entry.reason)] = entry.count;
}

static void from_json(const Json& json, RejectionTally& rejected) {
  for (const auto& [reason, count] : json.items()) rejected.add(reason, count.get<std::int64_t>());
}

static void to_json(Json& /*json*/, const ReferenceStatistics& /*nothing*/) {}
static void from_json(const Json& /*json*/, ReferenceStatistics& /*nothing*/) {}

TACHLESS_JSON_FIELDS(PlantStatistics, round_trip_us, wake_up_jitter_us, command_age_us,
                     missed_deadlines, longest_miss, missed_commands, longest_command_miss,
                     late_commands, missed_readings, longest_reading_miss, saturated_ticks,
                     beyond_limit_ticks, robot_is_clock, driver)
TACHLESS_JSON_FIELDS(ControllerStatistics, gaps, skipped_ticks, restarts)
TACHLESS_JSON_FIELDS(LoggerStatistics::Log, path, events, ticks, gaps)
TACHLESS_JSON_FIELDS(LoggerStatistics, log)
// These are the common fields. Role, exit code and fault need a conversion and are written apart.
TACHLESS_JSON_FIELDS(Statistics, run_id, ticks, wall_s, work_us, resends, duplicates, rejected)

// Below 16 ns there is one bucket per nanosecond. Above, the four bits after the leading one select
// the bucket.
std::size_t LatencyHistogram::bucket_of(std::int64_t ns) {
  const auto value = static_cast<std::uint64_t>(std::max<std::int64_t>(ns, 0));
  if (value < per_octave) return value;
  const auto exponent = static_cast<std::uint64_t>(std::bit_width(value) - 5);
  const std::uint64_t bucket = (exponent + 1) * per_octave + ((value >> exponent) & 15);
  return std::min<std::size_t>(bucket, num_buckets - 1);
}

std::int64_t LatencyHistogram::lower_edge(int bucket) {
  if (bucket < per_octave) return bucket;
  const int exponent = bucket / per_octave - 1;
  return std::int64_t{per_octave + bucket % per_octave} << exponent;
}

void LatencyHistogram::add(std::chrono::nanoseconds duration) {
  ++counts_[bucket_of(duration.count())];
  ++count_;
  max_ns_ = std::max<std::int64_t>(max_ns_, duration.count());
}

void LatencyHistogram::add(const Bucket& bucket) {
  counts_[bucket_of(std::llround(bucket.from_us * 1e3))] += bucket.count;
  count_ += bucket.count;
}

void LatencyHistogram::raise_max(double max_us) {
  max_ns_ = std::max<std::int64_t>(max_ns_, std::llround(max_us * 1e3));
}

double LatencyHistogram::percentile_us(double part) const {
  if (count_ == 0) return 0;
  const auto wanted =
      std::max<std::int64_t>(1, std::llround(std::ceil(part * static_cast<double>(count_))));
  std::int64_t seen = 0;
  for (int bucket = 0; bucket < num_buckets; ++bucket) {
    seen += counts_[static_cast<std::size_t>(bucket)];
    if (seen < wanted) continue;
    return static_cast<double>(std::min(lower_edge(bucket + 1) - 1, max_ns_)) * 1e-3;
  }
  return max_us();
}

std::vector<LatencyHistogram::Bucket> LatencyHistogram::buckets() const {
  std::vector<Bucket> result;
  for (int bucket = 0; bucket < num_buckets; ++bucket) {
    const std::int64_t count = counts_[static_cast<std::size_t>(bucket)];
    if (count > 0) result.push_back({static_cast<double>(lower_edge(bucket)) * 1e-3, count});
  }
  return result;
}

std::string_view RejectionTally::reason(std::size_t index) {
  static constexpr std::array<std::string_view, num_discards> discards = {
      "other_run", "not_asked", "too_old", "other_sender", "unauthenticated"};
  return index < num_rejections ? messages::name(static_cast<messages::Rejection>(index + 1))
                                : discards.at(index - num_rejections);
}

void RejectionTally::add(std::string_view name, std::int64_t count) {
  for (std::size_t i = 0; i < counts_.size(); ++i) counts_[i] += reason(i) == name ? count : 0;
}

std::vector<RejectionTally::Entry> RejectionTally::entries() const {
  std::vector<Entry> result;
  for (std::size_t i = 0; i < counts_.size(); ++i) result.push_back({reason(i), counts_[i]});
  return result;
}

std::int64_t RejectionTally::total() const {
  return std::accumulate(counts_.begin(), counts_.end(), std::int64_t{0});
}

std::string to_json(const Statistics& statistics) {
  Json json = {{"role", messages::name(statistics.role)},
               {"exit_code", static_cast<int>(statistics.exit_code)},
               {"fault", statistics.fault ? Json(*statistics.fault) : Json()}};
  to_json(json, statistics);
  std::visit([&](const auto& own) { to_json(json, own); }, statistics.own);
  return base::json_text(json);
}

Statistics statistics_from_json(const std::string& text) {
  try {
    const Json json = base::parse_json<Json>(text);
    const auto name = json.at("role").get<std::string>();
    int role = 0;
    while (role < messages::num_roles && messages::name(static_cast<messages::Role>(role)) != name)
      ++role;
    if (role == messages::num_roles) throw std::invalid_argument(fmt::format("role '{}'", name));
    Statistics statistics(static_cast<messages::Role>(role));
    statistics.exit_code = static_cast<base::ExitCode>(json.at("exit_code").get<int>());
    if (!json.at("fault").is_null()) statistics.fault = json.at("fault").get<std::string>();
    from_json(json, statistics);
    std::visit([&](auto& own) { from_json(json, own); }, statistics.own);
    return statistics;
  } catch (const nlohmann::json::exception& problem) {
    throw std::invalid_argument(problem.what());
  }
}

void write_statistics(const Statistics& statistics, const std::filesystem::path& path) {
  base::UnfinishedFile(path, "name a file in a writable place with --stats")
      .write(to_json(statistics) + "\n");
}

}  // namespace tachless::session
