#include "node/statistics.h"

#include <fmt/core.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "diagnostics/json_text.h"
#include "diagnostics/unfinished_file.h"
#include "loop/messages.h"

namespace tachless::node {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::array<std::string_view, num_discards> discard_names = {
    "other_run", "not_asked", "too_old", "other_sender", "unauthenticated"};

}  // namespace

// NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE, but for ordered_json, which it does not serve before 3.12.
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
                     late_commands, takeovers, saturated_ticks, beyond_limit_ticks)
TACHLESS_JSON_FIELDS(ControllerStatistics, gaps, skipped_ticks, restarts)
TACHLESS_JSON_FIELDS(LoggerStatistics::Log, path, events, ticks, gaps)
TACHLESS_JSON_FIELDS(LoggerStatistics, log)
// The head, but for what JSON has no type for: role, exit code and fault.
TACHLESS_JSON_FIELDS(Statistics, run_id, ticks, wall_s, work_us, resends, duplicates, rejected)

void RejectionTally::add(std::string_view reason, std::int64_t count) {
  for (int i = static_cast<int>(bus::Rejection::none) + 1; i < num_rejections; ++i) {
    const auto index = static_cast<std::size_t>(i);
    if (bus::name(static_cast<bus::Rejection>(i)) == reason) rejected_[index] += count;
  }
  for (std::size_t i = 0; i < discard_names.size(); ++i) {
    if (discard_names[i] == reason) discarded_[i] += count;
  }
}

std::vector<RejectionTally::Entry> RejectionTally::entries() const {
  std::vector<Entry> result;
  for (int i = static_cast<int>(bus::Rejection::none) + 1; i < num_rejections; ++i) {
    result.push_back(
        {bus::name(static_cast<bus::Rejection>(i)), rejected_[static_cast<std::size_t>(i)]});
  }
  for (std::size_t i = 0; i < discard_names.size(); ++i) {
    result.push_back({discard_names[i], discarded_[i]});
  }
  return result;
}

std::int64_t RejectionTally::total() const {
  std::int64_t result = 0;
  for (const Entry& entry : entries()) result += entry.count;
  return result;
}

Statistics::Statistics(loop::Role of) : role(of) {
  switch (of) {
    case loop::Role::plant:
      own = PlantStatistics();
      return;
    case loop::Role::reference:
      own = ReferenceStatistics();
      return;
    case loop::Role::controller:
      own = ControllerStatistics();
      return;
    case loop::Role::logger:
      own = LoggerStatistics();
      return;
  }
}

std::string to_json(const Statistics& statistics) {
  Json json = {{"role", loop::name(statistics.role)},
               {"exit_code", static_cast<int>(statistics.exit_code)},
               {"fault", statistics.fault ? Json(*statistics.fault) : Json()}};
  to_json(json, statistics);
  std::visit([&](const auto& own) { to_json(json, own); }, statistics.own);
  return diagnostics::json_text(json);
}

Statistics statistics_from_json(const std::string& text) {
  try {
    const Json json = Json::parse(text);
    const auto name = json.at("role").get<std::string>();
    constexpr std::array roles = {loop::Role::plant, loop::Role::reference, loop::Role::controller,
                                  loop::Role::logger};
    const auto role =
        std::ranges::find(roles, name, [](loop::Role each) { return loop::name(each); });
    if (role == roles.end()) throw std::invalid_argument(fmt::format("role '{}'", name));
    Statistics statistics(*role);
    statistics.exit_code = static_cast<diagnostics::ExitCode>(json.at("exit_code").get<int>());
    if (!json.at("fault").is_null()) statistics.fault = json.at("fault").get<std::string>();
    from_json(json, statistics);
    std::visit([&](auto& own) { from_json(json, own); }, statistics.own);
    return statistics;
  } catch (const nlohmann::json::exception& problem) {
    throw std::invalid_argument(problem.what());
  }
}

void write_statistics(const Statistics& statistics, const std::filesystem::path& path) {
  diagnostics::UnfinishedFile(path, "name a file in a writable place with --stats")
      .write(to_json(statistics) + "\n");
}

}  // namespace tachless::node
