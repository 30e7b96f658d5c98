#include "launch/summary.h"

#include <cmath>
#include <cstdio>
#include <map>

#include "launch/progress.h"

namespace launch {
namespace {

const nlohmann::json* of_role(const std::vector<nlohmann::json>& counters, std::string_view role) {
  for (const nlohmann::json& counter : counters) {
    if (counter.value("role", "") == role) return &counter;
  }
  return nullptr;
}

std::int64_t sum(const std::vector<nlohmann::json>& counters, const char* key) {
  std::int64_t total = 0;
  for (const nlohmann::json& counter : counters) total += counter.value(key, std::int64_t{0});
  return total;
}

nlohmann::ordered_json round_trip(const nlohmann::json* plant) {
  nlohmann::ordered_json result;
  for (const char* key : {"p50", "p99", "p999", "max"}) {
    result[key] = nullptr;
    if (plant != nullptr && plant->contains("round_trip_us") &&
        plant->at("round_trip_us").is_object()) {
      result[key] = plant->at("round_trip_us").value(key, nlohmann::json());
    }
  }
  return result;
}

}  // namespace

nlohmann::ordered_json summarise(const RunFacts& facts, const Tracking& tracking,
                                 const std::vector<nlohmann::json>& counters) {
  const nlohmann::json* plant = of_role(counters, "plant");
  const double wall_s = plant != nullptr ? plant->value("wall_s", facts.wall_s) : facts.wall_s;
  const auto ticks = static_cast<double>(tracking.num_ticks());
  const double duration_s = ticks * facts.period_s;

  nlohmann::ordered_json summary;
  summary["scenario"] = facts.scenario;
  summary["run_id"] = facts.run_id;
  summary["mode"] = facts.mode;
  summary["law"] = facts.law;
  summary["ticks"] = tracking.num_ticks();
  summary["period_s"] = facts.period_s;
  summary["duration_s"] = duration_s;
  summary["wall_s"] = wall_s;
  summary["ticks_per_s"] = wall_s > 0 ? nlohmann::json(ticks / wall_s) : nlohmann::json();
  summary["real_time_factor"] = wall_s > 0 ? nlohmann::json(duration_s / wall_s) : nlohmann::json();

  auto error = nlohmann::ordered_json::object();
  auto torque = nlohmann::ordered_json::object();
  for (const char* key : {"peak", "rms", "final"}) error[key] = nlohmann::json::array();
  for (const char* key : {"peak", "rms"}) torque[key] = nlohmann::json::array();
  for (const JointTracking& joint : tracking.joints()) {
    if (tracking.num_ticks() == 0) break;
    error["peak"].push_back(joint.error.peak());
    error["rms"].push_back(joint.error.rms());
    error["final"].push_back(joint.error.final());
    torque["peak"].push_back(joint.torque.peak());
    torque["rms"].push_back(joint.torque.rms());
  }
  summary["position_error_rad"] = error;
  summary["torque_Nm"] = torque;

  summary["round_trip_us"] = round_trip(plant);
  summary["resends"] = sum(counters, "resends");
  summary["duplicates"] = sum(counters, "duplicates");
  std::map<std::string, std::int64_t> rejected;
  for (const nlohmann::json& counter : counters) {
    if (!counter.contains("rejected")) continue;
    for (const auto& [reason, count] : counter.at("rejected").items()) {
      rejected[reason] += count.get<std::int64_t>();
    }
  }
  summary["rejected"] = nlohmann::ordered_json::object();
  for (const auto& [reason, count] : rejected) summary["rejected"][reason] = count;
  summary["missed_deadlines"] =
      plant != nullptr ? plant->value("missed_deadlines", std::int64_t{0}) : 0;
  summary["longest_miss"] = plant != nullptr ? plant->value("longest_miss", std::int64_t{0}) : 0;
  summary["log"] = {{"path", facts.log_path}, {"ticks", facts.log_ticks}, {"gaps", facts.log_gaps}};
  summary["fault"] = facts.fault ? nlohmann::json(*facts.fault) : nlohmann::json();
  return summary;
}

std::string short_period(double period_s) {
  char text[32];
  if (period_s < 0.9995e-3) {
    std::snprintf(text, sizeof text, "%.6g µs", period_s * 1e6);
  } else {
    std::snprintf(text, sizeof text, "%.6g ms", period_s * 1e3);
  }
  return text;
}

std::string closing_table(const nlohmann::ordered_json& summary,
                          const std::vector<std::string>& length_units,
                          const std::vector<std::string>& effort_units) {
  char row[192];
  std::snprintf(row, sizeof row, "  %5s  %35s   %25s\n  %5s  %11s %11s %11s   %12s %12s\n", "joint",
                "position error", "torque", "", "peak", "rms", "final", "peak", "rms");
  std::string text = row;
  const auto& error = summary.at("position_error_rad");
  const auto& torque = summary.at("torque_Nm");
  for (std::size_t i = 0; i < error.at("peak").size(); ++i) {
    std::snprintf(row, sizeof row, "  %5zu  %11.3e %11.3e %+11.3e %-3s %11.5g %12.5g %s\n", i + 1,
                  error.at("peak")[i].get<double>(), error.at("rms")[i].get<double>(),
                  error.at("final")[i].get<double>(), length_units[i].c_str(),
                  torque.at("peak")[i].get<double>(), torque.at("rms")[i].get<double>(),
                  effort_units[i].c_str());
    text += row;
  }

  std::snprintf(row, sizeof row, "\n  %lld ticks of %s, %s, in %.3g s",
                static_cast<long long>(summary.at("ticks").get<std::int64_t>()),
                short_period(summary.at("period_s").get<double>()).c_str(),
                summary.at("mode").get<std::string>().c_str(), summary.at("wall_s").get<double>());
  text += row;
  if (summary.at("ticks_per_s").is_number()) {
    std::snprintf(row, sizeof row, ": %s ticks/s, %.3g x real time",
                  short_rate(summary.at("ticks_per_s").get<double>()).c_str(),
                  summary.at("real_time_factor").get<double>());
    text += row;
  }
  text += "\n";
  const auto& trip = summary.at("round_trip_us");
  if (trip.at("p50").is_number()) {
    std::snprintf(
        row, sizeof row, "  round trip %.0f µs (median), %.0f µs (99 %%), %.0f µs (max)\n",
        trip.at("p50").get<double>(), trip.at("p99").get<double>(), trip.at("max").get<double>());
    text += row;
  }
  std::int64_t rejected = 0;
  for (const auto& [reason, count] : summary.at("rejected").items()) {
    rejected += count.get<std::int64_t>();
  }
  std::snprintf(row, sizeof row, "  log gaps %lld, resends %lld, datagrams rejected %lld",
                static_cast<long long>(summary.at("log").at("gaps").get<std::int64_t>()),
                static_cast<long long>(summary.at("resends").get<std::int64_t>()),
                static_cast<long long>(rejected));
  text += row;
  if (summary.at("mode") == "realtime") {
    std::snprintf(row, sizeof row, ", missed deadlines %lld (longest run of them %lld)",
                  static_cast<long long>(summary.at("missed_deadlines").get<std::int64_t>()),
                  static_cast<long long>(summary.at("longest_miss").get<std::int64_t>()));
    text += row;
  }
  return text + "\n";
}

}  // namespace launch
