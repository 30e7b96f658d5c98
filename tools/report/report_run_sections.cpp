#include "report/report_sections.h"

#include "certify/prediction.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace tachless::report {
namespace {

/// Returns the outline of a histogram [[from_us, count]…] in steps of a quarter octave, in percent.
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

/// Returns a channel without the robot's prefix: "COMMAND" for "ARM_COMMAND".
std::string suffix(const std::string& channel, const RecordedRun& run) {
  const std::string prefix = run.info.robot + "_";
  return channel.starts_with(prefix) ? channel.substr(prefix.size()) : channel;
}

Chart events_chart(const Overlay& all, const RecordedRun& run) {
  Chart chart = all.over_time(fmt::format("events-{}", run.number + 1),
                              "Saturated torques, missed commands and missing records");
  chart.heading = all.alone() ? "" : run.label;
  chart.wide = true;
  const auto bar = [&](const std::string& name, const std::vector<logger::TickRange>& ranges,
                       const char* colour) {
    if (ranges.empty()) return;
    const double row = -static_cast<double>(chart.curves.size());
    Curve curve{words(name), {}, colour, 9, {}, run.number};
    for (const auto& [from, to] : run.seconds(ranges)) {
      curve.points.insert(curve.points.end(), {{from, row}, {to, row}, {to, NAN}});
    }
    chart.curves.push_back(std::move(curve));
  };
  for (std::size_t joint = 0; joint < run.saturated.size(); ++joint) {
    bar(fmt::format("saturated {}", joint + 1), run.saturated[joint].listed, alarm_colour);
  }
  bar("missed", run.command_missed.listed, palette[3]);
  bar("stopped", run.protective_stop.listed, palette[1]);
  for (const auto& piece : run.summary.pieces) {
    if (!piece.absent()) bar("no " + suffix(piece.channel, run), piece.missing.listed, "#777777");
  }
  std::vector<logger::TickRange> faults;
  for (const auto& fault : run.summary.faults) faults.push_back({fault.tick, fault.tick});
  bar("fault", faults, palette[6]);
  chart.named_rows = true;
  chart.y_range = {{0.5 - static_cast<double>(chart.curves.size()), 0.5}};
  return chart;
}

/// Returns one list item per kind of event.
Html events_list(const RecordedRun& run) {
  Html items;
  const auto count = [&](const std::string& what, const Stretches& stretches) {
    if (stretches.count == 0) return;
    items += html("<li>{} in {} {} ({} %){}</li>", what, stretches.count,
                  stretches.count == 1 ? "tick" : "ticks",
                  fmt::format("{:.3g}", 100 * run.share_of(stretches)),
                  stretches.cut() ? ", of which the first stretches are drawn" : "");
  };
  for (std::size_t joint = 0; joint < run.saturated.size(); ++joint) {
    count(fmt::format("Torque of {} saturated", run.joints.joint(joint)), run.saturated[joint]);
  }
  if (run.contacts.ticks > 0) items += html("<li>{}</li>", run.contacts.heading());
  count("Command missed, the torque before held,", run.command_missed);
  count("Protective stop", run.protective_stop);
  for (const std::string& gap : run.summary.gap_texts()) {
    items += html("<li>In the log: {}</li>", gap);
  }
  for (const auto& [tick, gains] : run.summary.gains) {
    items += html("<li>Gains of the law from tick {}: {}</li>", tick,
                  gains.empty() ? "the scenario's" : gains);
  }
  for (const auto& fault : run.summary.faults) {
    items += html("<li>Fault of the {} at tick {}: {}</li>", messages::name(fault.role), fault.tick,
                  fault.text);
  }
  return items;
}

/// Returns a text on the certified bound of V and whether the run stayed below it.
Html certified_text(const RecordedRun& run) {
  const lyapunov::CertifiedRun& certified = *run.certified;
  const auto number = [](double x) { return fmt::format("{:.3g}", x); };
  Html text = html(" With ε<sub>1</sub> = {} 1/s, ε<sub>2</sub> = {}",
                   certify::list_text(certified.weights.eps_1),
                   certify::list_text(certified.weights.eps_2));
  if (certified.rate < 0) {
    text += html(
        " the matrix condition certifies V ≤ {} J, which does not hold this run's start with {} J: "
        "no bound.",
        number(certified.level), number(certified.V0));
    return text;
  }
  const char* const how = certified.proved ? "proved" : "sampled postures";
  if (std::isinf(certified.level)) {
    text += html(" V does not rise (in continuous time, proved for a constant reference).");
  } else if (certified.rate == 0) {
    text += html(
        " the matrix condition certifies that V does not rise from this start in continuous time "
        "({}), and stays below {} J.",
        how, number(certified.level));
  } else {
    text += html(
        " the matrix condition certifies from this start V ≤ V(0) exp(−{} t) in continuous time "
        "({}; dotted), and that V stays below {} J from anywhere below.",
        number(certified.rate), how, number(certified.level));
  }
  for (const std::string& each : certified.provisos) text += html(" But {}.", each);
  if (run.above_bound_s) {
    text += html(
        " <b class=\"alarm\">The bound is violated from {} s on</b>: the loop is not the one that "
        "is certified; see its period, delay, torque limits and model.",
        number(*run.above_bound_s));
  }
  return text;
}

Html lyapunov_text(const RecordedRun& run) {
  if (run.lyapunov_formula.empty()) {
    return html("for {} no function is evaluated.", run.scenario.controller.law_text());
  }
  Html text = html("<i>V</i> = {}, at the plant's true state and the law's own model.",
                   run.lyapunov_formula);
  if (run.certified) {
    text += certified_text(run);
  } else if (run.scenario.num_joints > lyapunov::most_joints_of_certified_run) {
    text += html(" Not computed for more than {} joints: see tachless certify.",
                 lyapunov::most_joints_of_certified_run);
  }
  return text;
}

/// Returns the certified bound from the start to the run's end, down to the last value of V.
Curve bound_of(const Overlay& all, const RecordedRun& run, const std::vector<study::Point>& V) {
  Curve bound{words(all.alone() ? "certified bound" : ""),
              {},
              run.above_bound_s ? alarm_colour : palette[6],
              1.4,
              {2, 3},
              run.number,
              "certified bound"};
  double least = V.front().y;
  for (const study::Point& each : V) least = each.y > 0 ? std::min(least, each.y) : least;
  constexpr int pieces = 200;
  for (int k = 0; k <= pieces; ++k) {
    const double t_s = V.back().x * k / pieces;
    if (const double y = run.certified->bound(t_s); y >= least) bound.points.push_back({t_s, y});
  }
  return bound;
}

}  // namespace

ReportSection lyapunov_section(const Overlay& all) {
  ReportSection section{"lyapunov", "Lyapunov function",
                        "There is no V to draw: it takes the true state (TRUTH), the reference and "
                        "the controller's state, of a law whose function is known."};
  Chart chart = all.over_time("lyapunov-v", "Lyapunov function along the run, logarithmic");
  chart.y_label = {"V", "", "", "J"};
  chart.wide = true;
  std::vector<Curve> fits;
  for (const RecordedRun& run : all.runs) {
    if (run.lyapunov_formula.empty()) continue;
    const std::vector<study::Point> V = run.lyapunov.points(all.budget);
    chart.curves.push_back(all.curve(run, V, "V", {}, 1.4));
    if (run.certified && run.certified->rate >= 0 && V.size() > 1) {
      fits.push_back(bound_of(all, run, V));
      // A level far above would flatten the curve.
      const double level = run.certified->level;
      if (level < 100 * run.certified->V0) chart.levels.push_back(level);
    }
    if (run.lyapunov_decay) fits.push_back(fitted(all, *run.lyapunov_decay, run));
  }
  const bool alike = std::ranges::all_of(all.runs, [&](const RecordedRun& run) {
    return lyapunov_text(run).markup() == lyapunov_text(all.runs.front()).markup();
  });
  for (const RecordedRun& run : all.runs) {
    if (alike && &run != &all.runs.front()) break;
    section.text += html("<p>{}{}</p>", alike ? "" : run.label + ": ", lyapunov_text(run));
  }
  section.text += html(
      "<p>A torque that is held over a tick, an encoder's counts and a payload keep V above "
      "zero.</p>");
  make_logarithmic(chart);
  chart.curves.insert(chart.curves.end(), fits.begin(), fits.end());
  section.add(std::move(chart));
  return section;
}

ReportSection timing_section(const Overlay& all) {
  ReportSection section{
      "timing", "Timing",
      "No summary.json of this run with times in it lies beside the log; a log itself has none."};
  section.text = html(
      "<p>From a tick's request to its command; in realtime also from a measurement to its "
      "command, "
      "and from a tick's deadline to its start in the plant: the share of all ticks (logarithmic) "
      "over the time that they took.</p>");
  struct Kind {
    const char* key;  ///< key in summary.json
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
    chart.heading = heading;
    chart.over_time = false;
    chart.x_label = words("time", "µs");
    chart.y_label = words("ticks", "%");
    chart.height_px = 200;
    chart.logarithmic_x = true;
    chart.logarithmic_y = true;
    double floor = INFINITY;
    for (const RecordedRun& run : all.runs) {
      const nlohmann::json times = run.outcome_of(key);
      if (!times.is_object() || !times.contains("histogram")) continue;
      chart.curves.push_back(all.curve(run, outline(times["histogram"]), "", {}, 1.6));
      for (const study::Point& point : chart.curves.back().points) floor = std::min(floor, point.y);
    }
    if (std::isfinite(floor)) chart.y_range = {{floor, INFINITY}};
    section.add(std::move(chart));
  }
  return section;
}

ReportSection events_section(const Overlay& all) {
  ReportSection section{"events", "Events and faults", ""};
  for (const RecordedRun& run : all.runs) {
    Chart chart = events_chart(all, run);
    if (chart.curves.empty() && run.summary.gap_texts().empty()) {
      section.text += html(
          "<p>{}No torque saturated, no command was missed, nothing is missing from the log, no "
          "process reported a fault.</p>",
          all.alone() ? "" : run.label + ": ");
    }
    if (const Html items = events_list(run); !items.empty()) {
      if (!all.alone()) section.text += html("<p>{}:</p>", run.label);
      section.text += html("<ul>{}</ul>\n", items);
    }
    section.add(std::move(chart));
  }
  return section;
}

}  // namespace tachless::report
