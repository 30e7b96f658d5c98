#include "node/statistics.h"

#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tachless::node {
namespace {

using Json = nlohmann::ordered_json;

std::string_view name(Discard reason) {
  switch (reason) {
    case Discard::other_run:
      return "other_run";
    case Discard::not_asked:
      return "not_asked";
    case Discard::too_old:
      return "too_old";
    case Discard::unauthenticated:
      return "unauthenticated";
  }
  throw std::logic_error("no such reason");
}

Json to_json(const LatencyHistogram& histogram) {
  Json buckets = Json::array();
  for (const auto& bucket : histogram.buckets()) {
    buckets.push_back({bucket.from_us, bucket.count});
  }
  return {{"p50", histogram.percentile_us(0.5)},
          {"p99", histogram.percentile_us(0.99)},
          {"p999", histogram.percentile_us(0.999)},
          {"max", histogram.max_us()},
          {"histogram", buckets}};
}

}  // namespace

std::vector<RejectionTally::Entry> RejectionTally::entries() const {
  std::vector<Entry> result;
  for (int i = static_cast<int>(bus::Rejection::none) + 1; i < num_rejections; ++i) {
    result.push_back(
        {bus::name(static_cast<bus::Rejection>(i)), rejected_[static_cast<std::size_t>(i)]});
  }
  for (int i = 0; i < num_discards; ++i) {
    result.push_back({name(static_cast<Discard>(i)), discarded_[static_cast<std::size_t>(i)]});
  }
  return result;
}

std::int64_t RejectionTally::total() const {
  std::int64_t result = 0;
  for (const Entry& entry : entries()) result += entry.count;
  return result;
}

std::string to_json(const Statistics& statistics) {
  Json rejected = Json::object();
  for (const auto& entry : statistics.rejected.entries()) {
    rejected[std::string(entry.reason)] = entry.count;
  }
  Json json = {{"role", loop::name(statistics.role)},
               {"exit_code", static_cast<int>(statistics.exit_code)},
               {"fault", nullptr},
               {"run_id", statistics.run_id},
               {"ticks", statistics.ticks},
               {"wall_s", statistics.wall_s},
               {"round_trip_us", to_json(statistics.round_trip)},
               {"work_us", to_json(statistics.work)},
               {"wake_up_jitter_us", to_json(statistics.wake_up_jitter)},
               {"command_age_us", to_json(statistics.command_age)},
               {"resends", statistics.resends},
               {"duplicates", statistics.duplicates},
               {"rejected", rejected},
               {"missed_deadlines", statistics.missed_deadlines},
               {"longest_miss", statistics.longest_miss},
               {"missed_commands", statistics.missed_commands},
               {"longest_command_miss", statistics.longest_command_miss},
               {"late_commands", statistics.late_commands},
               {"gaps", statistics.gaps},
               {"skipped_ticks", statistics.skipped_ticks},
               {"restarts", statistics.restarts},
               {"takeovers", statistics.takeovers},
               {"saturated_ticks", statistics.saturated_ticks},
               {"log", nullptr}};
  if (statistics.fault) json["fault"] = *statistics.fault;
  if (statistics.log) {
    json["log"] = {{"path", statistics.log->path},
                   {"events", statistics.log->events},
                   {"ticks", statistics.log->ticks},
                   {"gaps", statistics.log->gaps}};
  }
  return json.dump();
}

void write_statistics(const Statistics& statistics, const std::filesystem::path& path) {
  std::ofstream file(path);
  file << to_json(statistics) << '\n';
  file.close();
  if (!file) {
    throw diagnostics::Failure(
        diagnostics::ExitCode::bad_usage,
        "--stats: cannot write " + path.string() + "; name a file in a writable place");
  }
}

}  // namespace tachless::node
