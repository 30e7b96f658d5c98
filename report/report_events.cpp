#include "report/report_events.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "report/gnuplot.h"

namespace tachless::report {
namespace {

/// The outline of a histogram [[from_us, count]…] in steps of a quarter octave, in percent.
std::vector<study::Point> outline(const nlohmann::json& histogram) {
  constexpr double per_octave = 4;
  std::map<int, double> counts;
  double total = 0;
  for (const auto& bucket : histogram) {
    if (!bucket.is_array() || bucket.size() != 2 || !bucket[0].is_number() ||
        !bucket[1].is_number()) {
      continue;
    }
    const double from_us = std::max(bucket[0].get<double>(), 1e-3);
    const double count = bucket[1].get<double>();
    counts[static_cast<int>(std::floor(per_octave * std::log2(from_us) + 1e-9))] += count;
    total += count;
  }
  if (!(total > 0)) return {};
  const double floor = 50 / total;
  std::vector<study::Point> points;
  for (const auto& [bin, count] : counts) {
    const double from = std::exp2(bin / per_octave);
    const double to = std::exp2((bin + 1) / per_octave);
    const double share = 100 * count / total;
    if (points.empty() || from > points.back().x * 1.0001) points.push_back({from, floor});
    points.insert(points.end(), {{from, share}, {to, share}});
    if (!counts.contains(bin + 1)) points.push_back({to, floor});
  }
  return points;
}

std::string ticks_text(std::int64_t count) {
  return fmt::format("{} {}", count, count == 1 ? "tick" : "ticks");
}

/// "COMMAND" of "ARM_COMMAND".
std::string suffix(const std::string& channel, const RecordedRun& run) {
  const std::string prefix = run.info.robot + "_";
  return channel.starts_with(prefix) ? channel.substr(prefix.size()) : channel;
}

Chart events_chart(const Overlay& all, std::size_t i) {
  const RecordedRun& run = all.runs()[i];
  Chart chart = all.over_time(fmt::format("events-{}", i + 1),
                              "When torques saturated, commands were missed and records lack");
  chart.wide = true;
  const double h = run.info.period_s;
  const auto bar = [&](const std::string& name, const std::vector<logger::TickRange>& ranges,
                       const char* colour) {
    if (ranges.empty()) return;
    Bars bars{name, {}, colour};
    for (const auto& [first, last] : ranges) {
      bars.stretches.emplace_back(static_cast<double>(first) * h,
                                  static_cast<double>(last + 1) * h);
    }
    chart.bars.push_back(bars);
  };
  for (std::size_t joint = 0; joint < run.saturated.size(); ++joint) {
    bar(fmt::format("saturated {}", joint + 1), run.saturated[joint].listed(), alarm_colour);
  }
  bar("missed", run.command_missed.listed(), palette[3]);
  bar("stopped", run.protective_stop.listed(), palette[1]);
  for (const auto& piece : run.summary.pieces) {
    if (!piece.absent()) bar("no " + suffix(piece.channel, run), piece.missing_list, "#777777");
  }
  std::vector<logger::TickRange> faults;
  for (const auto& fault : run.summary.faults) faults.push_back({fault.tick, fault.tick});
  bar("fault", faults, palette[6]);
  return chart;
}

/// One list item each.
Html events_list(const RecordedRun& run) {
  Html items;
  const double ticks = std::max<double>(1, static_cast<double>(run.summary.ticks));
  const auto count = [&](const std::string& what, const Stretches& stretches) {
    if (stretches.ticks() == 0) return;
    items += html("<li>{} in {} ({} %){}</li>", what, ticks_text(stretches.ticks()),
                  fmt::format("{:.3g}", 100 * static_cast<double>(stretches.ticks()) / ticks),
                  stretches.cut() ? ", of which the first stretches are drawn" : "");
  };
  for (std::size_t joint = 0; joint < run.saturated.size(); ++joint) {
    count(fmt::format("Torque of {} saturated", run.joints.joint(joint)), run.saturated[joint]);
  }
  count("Command missed, the torque before held,", run.command_missed);
  count("Protective stop", run.protective_stop);
  for (const auto& piece : run.summary.pieces) {
    if (piece.absent() || piece.missing == 0) continue;
    items += html("<li>No {} in {}</li>", piece.channel,
                  ticks_text(static_cast<std::int64_t>(piece.missing)));
  }
  for (const auto& fault : run.summary.faults) {
    items += html("<li>Fault of the {} at tick {}: {}</li>", loop::name(fault.role), fault.tick,
                  fault.text);
  }
  return items;
}

}  // namespace

ReportSection timing_section(const Overlay& all) {
  ReportSection section{"timing", "Timing", {}, {}, ""};
  section.without =
      "No summary.json of this run with times in it lies beside the log; a log itself has none.";
  section.text = html(
      "<p>From a tick's question to its command; in realtime also from a measurement to its "
      "command, and from a tick's deadline to the plant's beginning it: how many of all ticks "
      "(logarithmic) took how long.</p>");
  struct Kind {
    const char* key;  ///< of summary.json
    const char* name;
    const char* heading;
  };
  for (const auto& [key, name, heading] :
       {Kind{"round_trip_us", "round-trip", "Round trip"},
        Kind{"command_age_us", "command-age", "Command age"},
        Kind{"wake_up_jitter_us", "wake-up", "Wake-up jitter"}}) {
    Chart chart;
    chart.name = name;
    chart.caption = fmt::format("{} times: histogram", heading);
    chart.x_label = "time [µs]";
    chart.y_label = "ticks  [%]";
    chart.logarithmic_x = true;
    chart.logarithmic_y = true;
    double floor = INFINITY;
    for (std::size_t i = 0; i < all.runs().size(); ++i) {
      const nlohmann::json& outcome = all.runs()[i].outcome;
      if (!outcome.is_object() || !outcome.contains(key) || !outcome[key].is_object() ||
          !outcome[key].contains("histogram")) {
        continue;
      }
      chart.curves.push_back(all.curve(i, outline(outcome[key]["histogram"]), "", "", 1.6));
      for (const study::Point& point : chart.curves.back().points) floor = std::min(floor, point.y);
    }
    if (std::isfinite(floor)) chart.y_range = {{floor, INFINITY}};
    section.add(heading, chart);
  }
  return section;
}

ReportSection events_section(const Overlay& all) {
  ReportSection section{"events", "Events and faults", {}, {}, ""};
  for (std::size_t i = 0; i < all.runs().size(); ++i) {
    const RecordedRun& run = all.runs()[i];
    Chart chart = events_chart(all, i);
    if (chart.bars.empty()) {
      section.text += html(
          "<p>{}No torque saturated, no command was missed, nothing is missing from the log, no "
          "process reported a fault.</p>",
          all.alone() ? "" : run.label + ": ");
    }
    if (const Html items = events_list(run); !items.empty()) {
      if (!all.alone()) section.text += html("<p>{}:</p>", run.label);
      section.text += html("<ul>{}</ul>\n", items);
    }
    section.add(all.alone() ? "" : run.label, std::move(chart), i);
  }
  return section;
}

}  // namespace tachless::report
