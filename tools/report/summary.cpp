#include "report/summary.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "base/text.h"
#include "certify/certify.h"

namespace tachless::report {
namespace {

using Json = nlohmann::ordered_json;
using session::Statistics;

const Statistics* of_role(const RunSummary& summary, messages::Role role) {
  const auto found = std::ranges::find(summary.statistics, role, &Statistics::role);
  return found == summary.statistics.end() ? nullptr : &*found;
}

/// Returns the counters of `role` beyond the common head; zeros without its statistics.
template <class Own>
Own own(const RunSummary& summary, messages::Role role) {
  const Statistics* found = of_role(summary, role);
  return found != nullptr ? std::get<Own>(found->own) : Own();
}

std::int64_t total(const RunSummary& summary, std::int64_t Statistics::*member) {
  std::int64_t result = 0;
  for (const Statistics& each : summary.statistics) result += each.*member;
  return result;
}

/// Returns percentiles and histogram; null if nothing was measured.
Json durations(const session::LatencyHistogram& measured) {
  Json result = measured;
  if (measured.count() > 0) return result;
  for (Json& each : result) each = nullptr;
  return result;
}

std::string percentile_row(const session::LatencyHistogram& measured, const char* what) {
  if (measured.count() == 0) return "";
  return fmt::format(
      "  {} {:.0f} µs (median), {:.0f} µs (99 %), {:.0f} µs (99.9 %), {:.0f} µs (max)\n", what,
      measured.percentile_us(0.5), measured.percentile_us(0.99), measured.percentile_us(0.999),
      measured.max_us());
}

/// Returns a line with a driver's own figures, if it has some.
std::string driver_rows(const session::PlantStatistics& plant) {
  if (plant.driver.empty()) return "";
  std::vector<std::string> figures;
  for (const auto& [name, value] : plant.driver) {
    figures.push_back(fmt::format("{} {:.6g}", name, value));
  }
  return fmt::format("  driver         {}\n", base::joined(figures));
}

/// Returns lines on the punctuality of a realtime run.
std::string realtime_rows(const session::PlantStatistics& plant) {
  return percentile_row(plant.command_age_us, "command age   ") +
         percentile_row(plant.wake_up_jitter_us, "wake-up jitter") +
         fmt::format(
             "  missed deadlines {} (longest run of them {}), missed commands {} (longest run of "
             "them {})\n",
             plant.missed_deadlines, plant.longest_miss, plant.missed_commands,
             plant.longest_command_miss) +
         (plant.missed_readings == 0
              ? ""
              : fmt::format("  ticks without a reading of the robot {} (longest run of them {})\n",
                            plant.missed_readings, plant.longest_reading_miss)) +
         driver_rows(plant);
}

/// Returns a value of each joint's errors or torques. A run without a tick has none.
Json per_joint(const study::Tracking& tracking, study::Extent study::JointTracking::*signal,
               double (study::Extent::*value)() const) {
  Json values = Json::array();
  for (const study::JointTracking& joint : tracking.joints()) {
    if (tracking.num_ticks() > 0) values.push_back((joint.*signal.*value)());
  }
  return values;
}

void add_statistics(Json& json, const RunSummary& summary) {
  const session::PlantStatistics plant = summary.plant();
  json["round_trip_us"] = durations(plant.round_trip_us);
  json["resends"] = total(summary, &Statistics::resends);
  json["duplicates"] = total(summary, &Statistics::duplicates);
  std::map<std::string, std::int64_t> rejected;
  for (const Statistics& each : summary.statistics) {
    for (const auto& entry : each.rejected.entries()) {
      rejected[std::string(entry.reason)] += entry.count;
    }
  }
  json["rejected"] = rejected;
  json["missed_deadlines"] = plant.missed_deadlines;
  json["longest_miss"] = plant.longest_miss;
  json["missed_commands"] = plant.missed_commands;
  json["longest_command_miss"] = plant.longest_command_miss;
  json["late_commands"] = plant.late_commands;
  json["missed_readings"] = plant.missed_readings;
  json["longest_reading_miss"] = plant.longest_reading_miss;
  json["skipped_ticks"] =
      own<session::ControllerStatistics>(summary, messages::Role::controller).skipped_ticks;
  json["wake_up_jitter_us"] = durations(plant.wake_up_jitter_us);
  json["command_age_us"] = durations(plant.command_age_us);
  json["saturated_ticks"] = plant.saturated_ticks;
  json["beyond_limit_ticks"] = plant.beyond_limit_ticks;
  json["robot_is_clock"] = plant.robot_is_clock;
  json["driver"] = plant.driver;
}

}  // namespace

double RunSummary::wall_s() const {
  const Statistics* plant = of_role(*this, messages::Role::plant);
  return plant != nullptr ? plant->wall_s : facts.wall_s;
}

std::int64_t RunSummary::ticks() const {
  const Statistics* plant = of_role(*this, messages::Role::plant);
  return plant != nullptr ? plant->ticks : tracking.num_ticks();
}

double RunSummary::duration_s() const {
  return static_cast<double>(ticks()) * scenario.loop.period_s;
}

session::PlantStatistics RunSummary::plant() const {
  return own<session::PlantStatistics>(*this, messages::Role::plant);
}

nlohmann::ordered_json to_json(const RunSummary& summary, const robot::JointLabels& joints) {
  const scenario::Scenario& scenario = summary.scenario;
  const RunFacts& facts = summary.facts;
  const double wall_s = summary.wall_s();
  const auto ticks = static_cast<double>(summary.ticks());
  Json json = {{"scenario", scenario.name},
               {"run_id", facts.run_id},
               {"mode", base::name_of(scenario.loop.mode)},
               {"law", scenario.controller.law_text()},
               {"joints", joints.name},
               {"ticks", summary.ticks()},
               {"period_s", scenario.loop.period_s},
               {"duration_s", summary.duration_s()},
               {"wall_s", wall_s},
               {"ticks_per_s", wall_s > 0 ? Json(ticks / wall_s) : Json()},
               {"real_time_factor", wall_s > 0 ? Json(summary.duration_s() / wall_s) : Json()},
               {"placement", facts.placement},
               {"predicted", certify::to_json(summary.predicted)}};
  for (const auto& [key, signal] : {std::pair{"position_error_rad", &study::JointTracking::error},
                                    std::pair{"torque_Nm", &study::JointTracking::torque}}) {
    json[key] = {{"peak", per_joint(summary.tracking, signal, &study::Extent::peak)},
                 {"rms", per_joint(summary.tracking, signal, &study::Extent::rms)}};
  }
  json["position_error_rad"]["final"] =
      per_joint(summary.tracking, &study::JointTracking::error, &study::Extent::final);
  add_statistics(json, summary);
  json["log"] = {{"path", facts.log_path}, {"ticks", facts.log_ticks}, {"gaps", facts.log_gaps}};
  json["contact"] = to_json(summary.contacts);
  json["robot_stopped"] = facts.robot_stopped ? Json(*facts.robot_stopped) : Json();
  json["dropped_output_bytes"] = facts.dropped_output_bytes;
  json["hidden_output_lines"] = facts.hidden_output_lines;
  json["outcome"] = summary.verdict.word();
  json["verdict"] = text(summary.verdict, joints);
  json["fault"] = facts.fault ? Json(*facts.fault) : Json();
  return json;
}

std::string closing_table(const RunSummary& summary, const robot::JointLabels& joints) {
  const study::Tracking& tracking = summary.tracking;
  const double wall_s = summary.wall_s();
  const auto ticks = static_cast<double>(summary.ticks());
  const session::PlantStatistics plant = summary.plant();
  std::vector<std::vector<std::string>> rows = {
      {"joint", "position error", "", "", "", "torque"},
      {"", "peak", "rms", "final", "", "peak", "rms", ""}};
  for (std::size_t i = 0; tracking.num_ticks() > 0 && i < tracking.joints().size(); ++i) {
    const study::Extent &error = tracking.joints()[i].error, &torque = tracking.joints()[i].torque;
    rows.push_back({fmt::format("{} {}", i + 1, base::printable(joints.name[i])),
                    fmt::format("{:.3e}", error.peak()), fmt::format("{:.3e}", error.rms()),
                    fmt::format("{:+.3e}", error.final()), joints.length[i],
                    fmt::format("{:.5g}", torque.peak()), fmt::format("{:.5g}", torque.rms()),
                    joints.effort[i]});
  }
  std::string text = base::table(rows, "lrrrlrrl");

  const scenario::LoopSpec& loop = summary.scenario.loop;
  text += fmt::format("\n  {}{} ticks of {}, {}, in {:.3g} s", summary.ticks(),
                      summary.ticks() < loop.num_ticks ? fmt::format(" of {}", loop.num_ticks) : "",
                      base::period_text(loop.period_s), base::name_of(loop.mode), wall_s);
  if (wall_s > 0) {
    text += fmt::format(": {} ticks/s, {:.3g} x real time", short_rate(ticks / wall_s),
                        summary.duration_s() / wall_s);
  }
  if (!summary.facts.placement.empty()) text += ", " + summary.facts.placement;
  text += "\n";
  text += loop.mode == scenario::Mode::realtime ? realtime_rows(plant)
                                                : percentile_row(plant.round_trip_us, "round trip");
  const auto row_of_ticks = [&](const std::vector<std::int64_t>& counts, const char* what) {
    for (std::size_t i = 0; i < counts.size(); ++i) {
      if (counts[i] != 0)
        text += fmt::format("  {} {} in {} ticks\n", joints.joint(i), what, counts[i]);
    }
  };
  const bool has_rate_limit = summary.scenario.plant.drive.torque_rate_limit_Nm_per_s.has_value();
  row_of_ticks(plant.saturated_ticks,
               has_rate_limit ? "at its torque or rate limit" : "at its torque limit");
  row_of_ticks(plant.beyond_limit_ticks, "beyond its range or its speed");
  std::int64_t rejected = 0;
  for (const Statistics& each : summary.statistics) rejected += each.rejected.total();
  if (summary.facts.robot_stopped) {
    text += *summary.facts.robot_stopped
                ? "  robot stopped by its driver\n"
                : "  robot NOT stopped: its driver ended first; use the emergency stop\n";
  }
  if (summary.contacts.ticks > 0) text += fmt::format("  {}\n", summary.contacts.text());
  text += fmt::format("  {}\n", study::text(summary.verdict, joints));
  return text + fmt::format("  log gaps {}, resends {}, datagrams rejected {}\n",
                            summary.facts.log_gaps, total(summary, &Statistics::resends), rejected);
}

std::string short_rate(double per_s) {
  if (per_s >= 1e6) return fmt::format("{:.1f} M", per_s / 1e6);
  if (per_s >= 1e3) return fmt::format("{:.1f} k", per_s / 1e3);
  return fmt::format("{:.0f}", per_s);
}

}  // namespace tachless::report
