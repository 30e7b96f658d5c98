#include "report/report_page.h"

#include <cmath>
#include <cstdio>
#include <functional>

#include "controller/registry.h"
#include "diagnostics/version.h"
#include "report/html.h"
#include "report/summary.h"

namespace tachless::report {
namespace {

constexpr const char* narrow_suffix = "-narrow";

constexpr const char* style = R"(
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: #1b1b1b;
  font: 16px/1.5 system-ui, "Segoe UI", Roboto, Helvetica, Arial, sans-serif; }
main { max-width: 72rem; margin: 0 auto; padding: 1.5rem 1.25rem 3rem; }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0 0 .25rem; overflow-wrap: anywhere; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .4rem; padding-top: .6rem; border-top: 1px solid #ccc; }
h2, h3 { break-after: avoid; }
p { margin: .3rem 0 .7rem; max-width: 48rem; }
.lead { color: #444; margin-bottom: 1.2rem; }
.alarm { border-left: 4px solid #d55e00; padding: .3rem .8rem; background: #fdf3ec; }
nav { display: flex; flex-wrap: wrap; gap: .2rem 1.1rem; font-size: .9rem; margin: 1rem 0 0; }
a { color: #00588a; }
/* A shade at the edge beyond which a table goes on; the white that hides it scrolls along. */
.table { overflow-x: auto; margin: .5rem 0 1rem; background:
  linear-gradient(90deg, #fff 40%, #fff0) 0 0 / 2rem 100% no-repeat local,
  linear-gradient(-90deg, #fff 40%, #fff0) 100% 0 / 2rem 100% no-repeat local,
  linear-gradient(90deg, #0003, #0000) 0 0 / .7rem 100% no-repeat scroll,
  linear-gradient(-90deg, #0003, #0000) 100% 0 / .7rem 100% no-repeat scroll; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { padding: .28rem .8rem .28rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid #e4e4e4; }
thead th { border-bottom: 1.5px solid #888; }
tbody th { font-weight: 600; white-space: nowrap; }
td.number, th.number { text-align: right; white-space: nowrap; }
td.run { min-width: 7.5em; overflow-wrap: anywhere; }
.facts td { overflow-wrap: anywhere; min-width: 9rem; }
.charts { display: grid; gap: 1rem 1.5rem;
  grid-template-columns: repeat(auto-fill, minmax(min(100%, 30rem), 1fr)); }
figure { margin: 0; break-inside: avoid; min-width: 0; }
figure.wide { grid-column: 1 / -1; }
figcaption { font-weight: 600; font-size: .9rem; margin-bottom: .1rem; }
figure svg { display: block; width: 100%; height: auto; }
.swatch { display: inline-block; width: 1.75em; height: .375em; margin-right: .45em;
  vertical-align: middle; }
.legend { display: flex; flex-wrap: wrap; gap: .1rem 1.4rem; font-size: .9rem; max-width: none; }
.narrow { display: none; }
details { margin: .5rem 0; }
pre { overflow-x: auto; background: #f6f6f6; padding: .7rem; font-size: .8rem; line-height: 1.35; }
code { font-size: .9em; overflow-wrap: anywhere; }
footer { margin-top: 2.5rem; color: #555; font-size: .85rem; }
@media (max-width: 44rem) {
  body { font-size: 15px; }
  main { padding: 1rem .75rem 2rem; }
  table { font-size: .8rem; }
  th, td { padding-right: .6rem; }
  .wide .narrow { display: block; }
  .wide .broad { display: none; }
}
@media print {
  @page { size: A4; margin: 15mm 14mm; }
  body { font-size: 9.5pt; }
  main { max-width: none; padding: 0; }
  nav, details:not([open]), #scenarios:not(:has([open])) { display: none; }
  h2 { margin-top: 1.2rem; }
  p, .legend { break-inside: avoid; break-after: avoid; }
  tr, #results { break-inside: avoid; }
  pre { white-space: pre-wrap; overflow: visible; }
  a { color: inherit; text-decoration: none; }
  .table { overflow: visible; background: none; }
  table { font-size: 8.5pt; }
  th, td { padding-right: .55rem; }
  /* Lines of a block stay with the heading before them; those of a grid or a flex box do not. */
  .charts, .legend { display: block; orphans: 1; widows: 1; }
  .legend span { margin-right: .9rem; }
  .legend .swatch { margin-right: .45em; }
  figure { display: inline-block; width: 49.5%; padding: 0 .4rem .5rem 0; }
  figure.wide { width: 100%; }
  .wide .narrow { display: none; }
  .wide .broad { display: block; }
}
)";

std::string number(const char* format, double value) {
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  std::string result(text);
  // A minus sign instead of a hyphen, and powers of ten as people write them.
  const std::size_t e = result.find('e');
  std::string mantissa = result.substr(0, e);
  if (mantissa.starts_with('-')) mantissa.replace(0, 1, "−");
  if (e == std::string::npos) return mantissa;
  int exponent = 0;
  std::sscanf(result.c_str() + e + 1, "%d", &exponent);
  if (exponent == 0) return mantissa;
  return mantissa + "·10<sup>" + (exponent < 0 ? "−" : "") + std::to_string(std::abs(exponent)) +
         "</sup>";
}

std::string list(const robot::Vector& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : ", ") + number("%.6g", value);
  return "[" + text + "]";
}

std::string_view text_of(const reference::Spec& reference) {
  struct Name {
    std::string_view operator()(const reference::trajectory::Hold&) { return "hold"; }
    std::string_view operator()(const reference::trajectory::Sinusoid&) { return "sinusoid"; }
    std::string_view operator()(const reference::trajectory::MultiSine&) {
      return "sum of sinusoids";
    }
    std::string_view operator()(const reference::trajectory::PointToPoint&) {
      return "point to point";
    }
    std::string_view operator()(const reference::trajectory::Waypoints&) { return "waypoints"; }
  };
  return std::visit(Name{}, reference);
}

std::string filter_text(const experiment::ControllerSpec& controller) {
  switch (controller.filter) {
    case controller::law::Discretisation::first_order_hold:
      return "first-order hold";
    case controller::law::Discretisation::tustin:
      return "Tustin";
    case controller::law::Discretisation::backward_euler:
      return "backward Euler";
    case controller::law::Discretisation::zero_order_hold:
      return "zero-order hold";
  }
  throw std::logic_error("report: no such filter");
}

/// In the law's order; a law unknown to this version has none.
std::string gains_text(const RecordedRun& run) {
  const experiment::ControllerSpec& spec = run.scenario.controller;
  std::vector<std::string> names;
  for (const controller::LawFacts& law : controller::laws()) {
    for (const controller::Parameter& parameter : law.parameters) {
      if (law.name == spec.law) names.emplace_back(parameter.name);
    }
  }
  if (names.empty()) {
    for (const auto& [name, value] : spec.gains) names.push_back(name);
  }
  std::string text;
  for (const std::string& name : names) {
    const auto found = spec.gains.find(name);
    if (found == spec.gains.end()) continue;
    text += (text.empty() ? "" : "<br>") + escaped(name) + " = " + list(found->second);
  }
  return text;
}

std::string encoder_text(const plant::EncoderSpec& encoder) {
  std::string text = encoder.resolution_bits
                         ? std::to_string(*encoder.resolution_bits) + " bit per revolution"
                         : "ideal";
  if (encoder.noise_std_rad > 0) {
    text += ", noise " + number("%.3g", encoder.noise_std_rad) + " rad";
  }
  return text;
}

/// Of a run's summary.json, an entry that is a number.
std::string outcome_number(const RecordedRun& run, const char* key, const char* format,
                           const char* unit) {
  if (!run.outcome.is_object() || !run.outcome.contains(key) || !run.outcome[key].is_number()) {
    return "";
  }
  return number(format, run.outcome[key].get<double>()) + unit;
}

std::string ended_text(const RecordedRun& run) {
  if (run.outcome.is_object() && run.outcome.contains("fault") &&
      run.outcome["fault"].is_string()) {
    return escaped(run.outcome["fault"].get<std::string>());
  }
  const std::int64_t ticks = run.summary.last_tick + 1;
  if (ticks == run.info.num_ticks) return "at its planned end";
  return "early, after " + std::to_string(ticks) + " of " + std::to_string(run.info.num_ticks) +
         " ticks";
}

std::string round_trip_text(const RecordedRun& run) {
  if (!run.outcome.is_object() || !run.outcome.contains("round_trip_us")) return "";
  const nlohmann::json& trip = run.outcome["round_trip_us"];
  std::string text;
  for (const auto& [key, name] : std::initializer_list<std::pair<const char*, const char*>>{
           {"p50", "median "}, {"p99", "99 % "}, {"p999", "99.9 % "}, {"max", "longest "}}) {
    if (!trip.is_object() || !trip.contains(key) || !trip[key].is_number()) continue;
    text += (text.empty() ? "" : ", ") + std::string(name) +
            number("%.0f", trip[key].get<double>()) + " µs";
  }
  return text;
}

std::string gaps_text(const RecordedRun& run) {
  std::string text;
  for (const auto& piece : run.summary.pieces) {
    if (piece.absent()) {
      text += (text.empty() ? "" : "; ") + ("no " + escaped(piece.channel));
    } else if (piece.missing != 0) {
      text += (text.empty() ? "" : "; ") + escaped(piece.channel) + " missing in " +
              std::to_string(piece.missing) + " ticks";
    }
  }
  return text.empty() ? "none" : text;
}

std::string damage_text(const RecordedRun& run) {
  if (!run.damage.any()) return "none";
  return std::to_string(run.damage.bytes_skipped) + " bytes at " +
         std::to_string(run.damage.stretches) + " places";
}

using Fact = std::pair<const char*, std::function<std::string(const RecordedRun&)>>;

const std::vector<Fact>& facts() {
  static const std::vector<Fact> all = {
      {"Scenario", [](const RecordedRun& run) { return escaped(run.scenario.name); }},
      {"Log",
       [](const RecordedRun& run) { return "<code>" + escaped(run.log.string()) + "</code>"; }},
      {"Run",
       [](const RecordedRun& run) {
         return std::to_string(run.run_id) + ", recorded by tachless " + escaped(run.info.version);
       }},
      {"Robot",
       [](const RecordedRun& run) {
         return escaped(run.scenario.robot.name) + ", " + std::to_string(run.scenario.num_joints) +
                (run.scenario.robot.flexible ? " flexible joints" : " rigid joints");
       }},
      {"Stiffness",
       [](const RecordedRun& run) {
         return run.scenario.robot.flexible
                    ? list(run.scenario.robot.flexible->stiffness) + " N m/rad"
                    : "";
       }},
      {"Payload",
       [](const RecordedRun& run) {
         return run.scenario.plant.payload.mass_kg > 0
                    ? number("%.4g", run.scenario.plant.payload.mass_kg) +
                          " kg, unknown to the controller"
                    : "";
       }},
      {"Law", [](const RecordedRun& run) { return escaped(run.scenario.controller.law); }},
      {"Measured",
       [](const RecordedRun& run) { return "<code>" + escaped(run.info.measurement) + "</code>"; }},
      {"Gains", gains_text},
      {"Filter",
       [](const RecordedRun& run) {
         return run.num_filters == 0 ? "" : filter_text(run.scenario.controller);
       }},
      {"Feed-forward lead",
       [](const RecordedRun& run) {
         return run.scenario.controller.feedforward_lead == experiment::FeedforwardLead::none
                    ? "none"
                    : "half a tick plus delay";
       }},
      {"Reference",
       [](const RecordedRun& run) { return std::string(text_of(run.scenario.reference)); }},
      {"Sampling",
       [](const RecordedRun& run) {
         return short_period(run.info.period_s) + ", " +
                (run.scenario.loop.command_delay == 0 ? "no delay, " : "delay of 1 tick, ") +
                (run.scenario.loop.mode == experiment::Mode::lockstep ? "lockstep" : "realtime");
       }},
      {"Encoder", [](const RecordedRun& run) { return encoder_text(run.scenario.plant.encoder); }},
      {"Torque limit",
       [](const RecordedRun& run) {
         const auto& limit = run.scenario.plant.drive.torque_limit_Nm;
         return limit ? list(*limit) + " N m" : std::string("none");
       }},
      {"Duration",
       [](const RecordedRun& run) {
         const std::int64_t ticks = run.summary.last_tick + 1;
         return number("%.6g", static_cast<double>(ticks) * run.info.period_s) + " s, " +
                std::to_string(ticks) + " ticks";
       }},
      {"Ended", ended_text},
      {"Gaps in the log", gaps_text},
      {"Damage to the log", damage_text},
      {"Wall-clock time",
       [](const RecordedRun& run) {
         const std::string wall = outcome_number(run, "wall_s", "%.3g", " s");
         const std::string rate = outcome_number(run, "real_time_factor", "%.3g", " × real time");
         return wall.empty() || rate.empty() ? wall : wall + ", " + rate;
       }},
      {"Round trip", round_trip_text},
      {"Missed commands",
       [](const RecordedRun& run) {
         return run.scenario.loop.mode == experiment::Mode::realtime
                    ? outcome_number(run, "missed_commands", "%.0f", "")
                    : "";
       }},
      {"Missed deadlines",
       [](const RecordedRun& run) {
         return run.scenario.loop.mode == experiment::Mode::realtime
                    ? outcome_number(run, "missed_deadlines", "%.0f", "")
                    : "";
       }},
  };
  return all;
}

std::string swatch(std::size_t run) {
  std::string dash = run_dash(run);
  if (!dash.empty()) dash = " stroke-dasharray=\"" + dash.substr(1, dash.size() - 2) + "\"";
  return "<svg class=\"swatch\" viewBox=\"0 0 28 6\" aria-hidden=\"true\"><line x1=\"0\" y1=\"3\" "
         "x2=\"28\" y2=\"3\" stroke-width=\"4\" stroke=\"" +
         run_colour(run) + "\"" + dash + "/></svg>";
}

std::string legend(const std::vector<RecordedRun>& runs) {
  if (runs.size() < 2) return "";
  std::string text = "<p class=\"legend\">";
  for (std::size_t i = 0; i < runs.size(); ++i) {
    text += "<span>" + swatch(i) + escaped(runs[i].label) + "</span> ";
  }
  return text + "</p>\n";
}

std::string facts_table(const std::vector<RecordedRun>& runs) {
  std::string text = "<div class=\"table\"><table class=\"facts\">\n";
  if (runs.size() > 1) {
    text += "<thead><tr><td></td>";
    for (std::size_t i = 0; i < runs.size(); ++i) {
      text += "<th scope=\"col\">" + swatch(i) + escaped(runs[i].label) + "</th>";
    }
    text += "</tr></thead>\n";
  }
  text += "<tbody>\n";
  for (const auto& [name, value] : facts()) {
    std::string cells;
    bool any = false;
    for (const RecordedRun& run : runs) {
      const std::string cell = value(run);
      any = any || !cell.empty();
      cells += "<td>" + (cell.empty() ? "–" : cell) + "</td>";
    }
    if (any) text += "<tr><th scope=\"row\">" + std::string(name) + "</th>" + cells + "</tr>\n";
  }
  return text + "</tbody></table></div>\n";
}

std::string results_table(const std::vector<RecordedRun>& runs) {
  std::string text =
      "<div class=\"table\"><table>\n<thead><tr>" +
      std::string(runs.size() > 1 ? "<th scope=\"col\">Run</th>" : "") +
      "<th scope=\"col\">Joint</th><th class=\"number\" scope=\"col\">peak |e|</th>"
      "<th class=\"number\" scope=\"col\">rms e</th><th class=\"number\" scope=\"col\">final e</th>"
      "<th class=\"number\" scope=\"col\">decay</th><th class=\"number\" scope=\"col\">peak "
      "|τ|</th>"
      "<th class=\"number\" scope=\"col\">rms τ</th><th class=\"number\" "
      "scope=\"col\">saturated</th>"
      "</tr></thead>\n<tbody>\n";
  const auto cell = [](const std::string& content) {
    return "<td class=\"number\">" + content + "</td>";
  };
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const RecordedRun& run = runs[i];
    if (run.tracking.num_ticks() == 0) continue;
    for (std::size_t joint = 0; joint < run.tracking.joints().size(); ++joint) {
      const JointTracking& signals = run.tracking.joints()[joint];
      const std::string& length = run.units.length[joint];
      const std::string& effort = run.units.effort[joint];
      const double share = 100 * static_cast<double>(run.saturated[joint].ticks()) /
                           static_cast<double>(run.tracking.num_ticks());
      text +=
          "<tr>" +
          (runs.size() > 1 ? "<td class=\"run\">" + swatch(i) + escaped(run.label) + "</td>" : "") +
          "<th scope=\"row\">" + std::to_string(joint + 1) + "</th>" +
          cell(number("%.2e", signals.error.peak()) + " " + length) +
          cell(number("%.2e", signals.error.rms()) + " " + length) +
          cell(number("%.2e", signals.error.final()) + " " + length) +
          cell(run.decay[joint] ? number("%.3g", run.decay[joint]->rate_per_s) + " 1/s"
                                : "no decay fits") +
          cell(number("%.5g", signals.torque.peak()) + " " + effort) +
          cell(number("%.5g", signals.torque.rms()) + " " + effort) +
          cell(number("%.3g", share) + " %") + "</tr>\n";
    }
  }
  return text + "</tbody></table></div>\n";
}

std::string alarms(const std::vector<RecordedRun>& runs) {
  std::string text;
  for (const RecordedRun& run : runs) {
    const std::string who = runs.size() > 1 ? "<b>" + escaped(run.label) + "</b>: " : "";
    const bool fault = run.outcome.is_object() && run.outcome.contains("fault") &&
                       run.outcome["fault"].is_string();
    if (fault || run.summary.last_tick + 1 != run.info.num_ticks) {
      text += "<p class=\"alarm\">" + who + "The run ended " + ended_text(run) + ".</p>\n";
    }
    if (run.damage.any()) {
      text += "<p class=\"alarm\">" + who + "The log is damaged: " + damage_text(run) +
              " are no events. What is intact is shown.</p>\n";
    }
  }
  return text;
}

std::string drawing(const Drawings& drawings, const std::string& name, const Chart& chart) {
  const auto found = drawings.find(name);
  if (found == drawings.end()) return "<p>" + escaped(chart.caption) + " (not drawn)</p>";
  return inline_svg(found->second, name + "-", chart.caption);
}

std::string figure(const ReportChart& report, const Drawings& drawings) {
  const Chart& chart = report.chart;
  std::string text =
      std::string("<figure id=\"") + chart.name + "\"" + (chart.wide ? " class=\"wide\">" : ">");
  if (!report.heading.empty()) text += "<figcaption>" + escaped(report.heading) + "</figcaption>";
  if (chart.wide) {
    text += "<div class=\"broad\">" + drawing(drawings, chart.name, chart) + "</div>";
    text +=
        "<div class=\"narrow\">" + drawing(drawings, chart.name + narrow_suffix, chart) + "</div>";
  } else {
    text += drawing(drawings, chart.name, chart);
  }
  return text + "</figure>\n";
}

std::string title_of(const std::vector<RecordedRun>& runs) {
  if (runs.size() == 1) {
    return escaped(runs[0].scenario.name + ": " + runs[0].scenario.controller.law +
                   ", h = " + short_period(runs[0].info.period_s));
  }
  std::string text;
  for (const RecordedRun& run : runs) text += (text.empty() ? "" : " · ") + escaped(run.label);
  return text;
}

}  // namespace

std::vector<Chart> drawn_charts(const std::vector<ReportSection>& sections) {
  std::vector<Chart> charts;
  for (const ReportSection& section : sections) {
    for (const ReportChart& report : section.charts) {
      charts.push_back(report.chart);
      if (!report.chart.wide) continue;
      charts.push_back(report.chart);
      charts.back().name += narrow_suffix;
      charts.back().wide = false;
    }
  }
  return charts;
}

std::string report_page(const std::vector<RecordedRun>& runs,
                        const std::vector<ReportSection>& sections, const Drawings& drawings) {
  const std::string title = title_of(runs);
  std::string page =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<link rel=\"icon\" href=\"data:,\">\n<title>" +
      title + "</title>\n<style>" + style + "</style>\n</head>\n<body>\n<main>\n<h1>" + title +
      "</h1>\n<p class=\"lead\">Recorded position, torque and filter state of " +
      (runs.size() == 1 ? std::string("one run") : std::to_string(runs.size()) + " runs") +
      " of the loop, tick by tick.</p>\n" + alarms(runs);
  page += "<nav>";
  for (const ReportSection& section : sections) {
    page += "<a href=\"#" + section.name + "\">" + section.heading + "</a>";
  }
  page += "</nav>\n<section id=\"facts\"><h2>Run facts</h2>\n" + facts_table(runs) +
          "</section>\n<section id=\"results\"><h2>Results</h2>\n<p>Errors are measured minus "
          "reference; torques as applied.</p>\n" +
          results_table(runs) + "</section>\n";
  for (const ReportSection& section : sections) {
    page += "<section id=\"" + section.name + "\"><h2>" + section.heading + "</h2>\n";
    if (!section.text.empty() && !section.text.starts_with("<p")) {
      page += "<p>" + section.text + "</p>\n";
    } else {
      page += section.text + "\n";
    }
    if (section.charts.empty() && !section.without.empty()) {
      page += "<p>" + section.without + "</p>\n";
    }
    if (!section.charts.empty() && section.name != "events") page += legend(runs);
    page += "<div class=\"charts\">\n";
    for (const ReportChart& chart : section.charts) page += figure(chart, drawings);
    page += "</div>\n</section>\n";
  }
  page += "<section id=\"scenarios\"><h2>Scenario</h2>\n";
  for (const RecordedRun& run : runs) {
    // Of one run it is on the page, and on paper; of several the differences are in the table.
    page += std::string(runs.size() == 1 ? "<details open>" : "<details>") + "<summary>" +
            escaped(run.label) + "</summary><pre>" + escaped(run.info.scenario) +
            "</pre></details>\n";
  }
  page += "</section>\n<footer>Written by tachless " + escaped(diagnostics::version) +
          ". The controller's commands can be computed again from the log: <code>tachless replay " +
          escaped(runs.front().log.string()) + "</code></footer>\n</main>\n</body>\n</html>\n";
  return page;
}

}  // namespace tachless::report
