#include "report/summary.h"

#include <fmt/format.h>

#include <map>

namespace tachless::report {
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

/// Of durations that the plant has measured, the histogram [[from_us, count]…] too; null where
/// there is none.
nlohmann::ordered_json percentiles(const nlohmann::json* plant, const char* durations) {
  nlohmann::ordered_json result;
  const bool measured =
      plant != nullptr && plant->contains(durations) && plant->at(durations).is_object() &&
      !(plant->at(durations).contains("histogram") && plant->at(durations).at("histogram").empty());
  for (const char* key : {"p50", "p99", "p999", "max", "histogram"}) {
    result[key] = measured ? plant->at(durations).value(key, nlohmann::json()) : nlohmann::json();
  }
  return result;
}

std::int64_t count(const nlohmann::json* counters, const char* key) {
  return counters != nullptr ? counters->value(key, std::int64_t{0}) : 0;
}

std::string percentile_row(const nlohmann::ordered_json& durations, const char* what) {
  if (!durations.at("p50").is_number()) return "";
  const auto us = [&](const char* key) { return durations.at(key).get<double>(); };
  return fmt::format(
      "  {} {:.0f} µs (median), {:.0f} µs (99 %), {:.0f} µs (99.9 %), {:.0f} µs (max)\n", what,
      us("p50"), us("p99"), us("p999"), us("max"));
}

/// Lines on how punctual a realtime run was.
std::string realtime_rows(const nlohmann::ordered_json& summary) {
  const auto number = [&](const char* key) { return summary.at(key).get<std::int64_t>(); };
  return percentile_row(summary.at("command_age_us"), "command age   ") +
         percentile_row(summary.at("wake_up_jitter_us"), "wake-up jitter") +
         fmt::format(
             "  missed deadlines {} (longest run of them {}), missed commands {} (longest run of "
             "them {})\n",
             number("missed_deadlines"), number("longest_miss"), number("missed_commands"),
             number("longest_command_miss"));
}

}  // namespace

nlohmann::ordered_json summarise(const RunFacts& facts, const report::Tracking& tracking,
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
  for (const report::JointTracking& joint : tracking.joints()) {
    if (tracking.num_ticks() == 0) break;
    error["peak"].push_back(joint.error.peak());
    error["rms"].push_back(joint.error.rms());
    error["final"].push_back(joint.error.final());
    torque["peak"].push_back(joint.torque.peak());
    torque["rms"].push_back(joint.torque.rms());
  }
  summary["position_error_rad"] = error;
  summary["torque_Nm"] = torque;

  summary["round_trip_us"] = percentiles(plant, "round_trip_us");
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
  const nlohmann::json* controller = of_role(counters, "controller");
  summary["takeovers"] = count(plant, "takeovers");
  summary["missed_deadlines"] = count(plant, "missed_deadlines");
  summary["longest_miss"] = count(plant, "longest_miss");
  summary["missed_commands"] = count(plant, "missed_commands");
  summary["longest_command_miss"] = count(plant, "longest_command_miss");
  summary["late_commands"] = count(plant, "late_commands");
  summary["skipped_ticks"] = count(controller, "skipped_ticks");
  summary["wake_up_jitter_us"] = percentiles(plant, "wake_up_jitter_us");
  summary["command_age_us"] = percentiles(plant, "command_age_us");
  summary["saturated_ticks"] = plant != nullptr
                                   ? plant->value("saturated_ticks", nlohmann::json::array())
                                   : nlohmann::json::array();
  summary["log"] = {{"path", facts.log_path}, {"ticks", facts.log_ticks}, {"gaps", facts.log_gaps}};
  summary["fault"] = facts.fault ? nlohmann::json(*facts.fault) : nlohmann::json();
  return summary;
}

std::string short_period(double period_s) {
  return period_s < 0.9995e-3 ? fmt::format("{:.6g} µs", period_s * 1e6)
                              : fmt::format("{:.6g} ms", period_s * 1e3);
}

std::string closing_table(const nlohmann::ordered_json& summary,
                          const std::vector<std::string>& length_units,
                          const std::vector<std::string>& effort_units) {
  std::string text =
      fmt::format("  {:>5}  {:>35}   {:>25}\n  {:>5}  {:>11} {:>11} {:>11}   {:>12} {:>12}\n",
                  "joint", "position error", "torque", "", "peak", "rms", "final", "peak", "rms");
  const auto& error = summary.at("position_error_rad");
  const auto& torque = summary.at("torque_Nm");
  for (std::size_t i = 0; i < error.at("peak").size(); ++i) {
    const auto of = [i](const auto& signal, const char* key) {
      return signal.at(key)[i].template get<double>();
    };
    text += fmt::format("  {:>5}  {:11.3e} {:11.3e} {:+11.3e} {:<3} {:11.5g} {:12.5g} {}\n", i + 1,
                        of(error, "peak"), of(error, "rms"), of(error, "final"), length_units[i],
                        of(torque, "peak"), of(torque, "rms"), effort_units[i]);
  }

  text +=
      fmt::format("\n  {} ticks of {}, {}, in {:.3g} s", summary.at("ticks").get<std::int64_t>(),
                  short_period(summary.at("period_s").get<double>()),
                  summary.at("mode").get<std::string>(), summary.at("wall_s").get<double>());
  if (summary.at("ticks_per_s").is_number()) {
    text += fmt::format(": {} ticks/s, {:.3g} x real time",
                        short_rate(summary.at("ticks_per_s").get<double>()),
                        summary.at("real_time_factor").get<double>());
  }
  text += "\n";
  text += summary.at("mode") == "realtime"
              ? realtime_rows(summary)
              : percentile_row(summary.at("round_trip_us"), "round trip");
  for (std::size_t i = 0; i < summary.at("saturated_ticks").size(); ++i) {
    const auto ticks = summary.at("saturated_ticks")[i].get<std::int64_t>();
    if (ticks == 0) continue;
    text += fmt::format("  joint {} at its torque limit in {} ticks\n", i + 1, ticks);
  }
  std::int64_t rejected = 0;
  for (const auto& [reason, count] : summary.at("rejected").items()) {
    rejected += count.get<std::int64_t>();
  }
  return text + fmt::format("  log gaps {}, resends {}, datagrams rejected {}\n",
                            summary.at("log").at("gaps").get<std::int64_t>(),
                            summary.at("resends").get<std::int64_t>(), rejected);
}

std::string short_rate(double per_s) {
  if (per_s >= 1e6) return fmt::format("{:.1f} M", per_s / 1e6);
  if (per_s >= 1e3) return fmt::format("{:.1f} k", per_s / 1e3);
  return fmt::format("{:.0f}", per_s);
}

}  // namespace tachless::report
