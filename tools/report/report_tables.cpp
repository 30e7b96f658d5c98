#include "report/report_sections.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <initializer_list>
#include <map>
#include <utility>

#include "base/schema.h"
#include "base/text.h"
#include "report/chart.h"
#include "report/summary.h"
#include "scenario/yaml_tree.h"

namespace tachless::report {
namespace {

/// Returns a number of a run's summary.json in fmt's `pattern`; empty if there is none.
Html outcome_number(const RecordedRun& run, const char* key, fmt::format_string<double> pattern) {
  const nlohmann::json value = run.outcome_of(key);
  return value.is_number() ? number(fmt::format(pattern, value.get<double>())) : Html();
}

std::string ended_text(const RecordedRun& run) {
  std::string reason = run.summary.stop_reason(run.info.num_ticks);
  return reason.empty() ? "at its planned end" : reason;
}

Html wall_text(const RecordedRun& run) {
  const Html wall = outcome_number(run, "wall_s", "{:.3g}");
  const Html rate = outcome_number(run, "real_time_factor", "{:.3g}");
  if (wall.empty()) return {};
  return rate.empty() ? html("{} s", wall) : html("{} s, {} × real time", wall, rate);
}

Html round_trip_text(const RecordedRun& run) {
  const nlohmann::json trip = run.outcome_of("round_trip_us");
  std::vector<Html> parts;
  for (const auto& [key, name] : std::initializer_list<std::pair<const char*, const char*>>{
           {"p50", "median"}, {"p99", "99 %"}, {"p999", "99.9 %"}, {"max", "longest"}}) {
    if (!trip.is_object() || !trip.contains(key) || !trip[key].is_number()) continue;
    parts.push_back(html("{} {} µs", name, fmt::format("{:.0f}", trip[key].get<double>())));
  }
  return joined(parts, Html(", "));
}

std::string gaps_text(const RecordedRun& run) {
  const std::vector<std::string> gaps = run.summary.gap_texts();
  return gaps.empty() ? "none" : base::joined(gaps, "; ");
}

Html sampling_text(const RecordedRun& run) {
  const int delay = run.scenario.loop.command_delay;
  return html(
      "{}, {}, {}", base::period_text(run.info.period_s),
      delay == 0 ? "no delay" : fmt::format("delay of {} tick{}", delay, delay == 1 ? "" : "s"),
      run.scenario.loop.mode == scenario::Mode::lockstep ? "lockstep" : "realtime");
}

Html duration_text(const RecordedRun& run) {
  return html("{} s, {} ticks", number(fmt::format("{:.6g}", run.end_s())),
              run.summary.last_tick + 1);
}

Html predicted_text(const RecordedRun& run) {
  const nlohmann::json predicted = run.outcome_of("predicted");
  if (!predicted.is_object()) return {};
  const auto text = predicted.find("text");
  return text != predicted.end() && text->is_string() ? Html(text->get<std::string>()) : Html();
}

/// Returns rows of facts that the scenario below the table does not state: name and value for
/// `run`. A value is empty if the run has none.
std::vector<std::pair<const char*, Html>> facts_of(const RecordedRun& run) {
  const scenario::Scenario& scenario = run.scenario;
  const bool realtime = scenario.loop.mode == scenario::Mode::realtime;
  const auto missed = [&](const char* key) {
    return realtime ? outcome_number(run, key, "{:.0f}") : Html();
  };
  return {
      {"Scenario", Html(scenario.name)},
      {"Log", html("<code>{}</code>", run.log.string())},
      {"Run", html("{}, recorded by tachless {}", run.run_id, run.info.version)},
      {"Robot", html("{}, {} {} joints", scenario.robot.name, scenario.num_joints,
                     scenario.robot.flexible ? "flexible" : "rigid")},
      {"Law", Html(scenario.controller.law_text())},
      {"Measured", html("<code>{}</code>", run.info.measurement)},
      {"Sampling", sampling_text(run)},
      {"Predicted", predicted_text(run)},
      {"Duration", duration_text(run)},
      {"Ended", Html(ended_text(run))},
      {"Gaps in the log", Html(gaps_text(run))},
      {"Damage to the log", Html(run.damage.text())},
      {"Wall-clock time", wall_text(run)},
      {"Round trip", round_trip_text(run)},
      {"Missed commands", missed("missed_commands")},
      {"Missed deadlines", missed("missed_deadlines")},
  };
}

Html results_row(const RecordedRun& run, std::size_t joint) {
  const study::JointTracking& signals = run.tracking.joints()[joint];
  const std::string& length = run.joints.length[joint];
  const std::string& effort = run.joints.effort[joint];
  const auto cell = [](const std::string& printed, const std::string& unit) {
    return html("<td class=\"number\">{} {}</td>", number(printed), unit);
  };
  Html row = html("<th scope=\"row\">{} {}</th>", joint + 1, run.joints.name[joint]);
  row += cell(fmt::format("{:.2e}", signals.error.peak()), length);
  row += cell(fmt::format("{:.2e}", signals.error.rms()), length);
  row += cell(fmt::format("{:.2e}", signals.error.final()), length);
  const auto& decay = run.decay[joint];
  row += decay ? cell(fmt::format("{:.3g}", decay->rate_per_s), "1/s")
               : html("<td class=\"number\">no decay fits</td>");
  row += cell(fmt::format("{:.5g}", signals.torque.peak()), effort);
  row += cell(fmt::format("{:.5g}", signals.torque.rms()), effort);
  row += cell(fmt::format("{:.3g}", 100 * run.share_of(run.saturated[joint])), "%");
  return row;
}

/// Returns a row with a column for each run. An empty value becomes –. Marks the values that differ
/// from the first run's.
Html run_row(const Html& name, const std::vector<Html>& values) {
  return html("<tr><th scope=\"row\">{}</th>{}</tr>\n", name, each(values, [&](const Html& value) {
                const bool differs = value.markup() != values.front().markup();
                return html("<td{}>{}</td>", Html::from_markup(differs ? " class=\"differs\"" : ""),
                            value.empty() ? Html("–") : value);
              }));
}

/// Returns a table of such rows.
Html run_table(const std::vector<RecordedRun>& runs, const char* id, const Html& rows) {
  const Html names = each(runs, [](const RecordedRun& run) {
    return html("<th scope=\"col\">{}{}</th>", swatch(run), run.label);
  });
  return html(
      "<div class=\"table\"><table class=\"facts\"{}>\n{}<tbody>\n{}</tbody></table></div>\n",
      Html::from_markup(id),
      runs.size() < 2 ? Html() : html("<thead><tr><td></td>{}</tr></thead>\n", names), rows);
}

using Values = std::map<std::string, std::string>;  // "loop.period_s" -> "1.0e-3"

void collect(const scenario::YamlNode& node, const std::string& key, Values& values) {
  if (node.kind != scenario::YamlNode::Kind::map) {
    values[key] = scenario::emit_yaml(node);
    return;
  }
  for (std::size_t i = 0; i < node.keys.size(); ++i) {
    collect(node.children[i], (key.empty() ? "" : key + ".") + node.keys[i], values);
  }
}

std::vector<std::string> without(const std::vector<std::string>& names,
                                 const std::vector<std::string>& others) {
  std::vector<std::string> rest;
  for (const std::string& name : names) {
    if (std::find(others.begin(), others.end(), name) == others.end()) rest.push_back(name);
  }
  return rest;
}

/// Returns a text on joints that only some runs' robots have.
Html robots_text(const std::vector<RecordedRun>& runs) {
  const std::vector<std::string>& first = runs.front().joints.name;
  Html text;
  for (const RecordedRun& run : runs) {
    const std::vector<std::string>& names = run.joints.name;
    if (names == first) continue;
    const auto listed = [](const std::vector<std::string>& joints) {
      return joints.empty() ? "no joint" : base::joined(joints);
    };
    text += html(
        "<p class=\"alarm\">The robots have other joints: {} has {}, {} has {}. Joints of one name "
        "share a chart. Only {} has: {}; only {} has: {}.</p>\n",
        runs.front().label, first.size(), run.label, names.size(), runs.front().label,
        listed(without(first, names)), run.label, listed(without(names, first)));
  }
  return text;
}

}  // namespace

Html swatch(const RecordedRun& run) {
  Html dash;
  if (const std::vector<int> lengths = dash_of(run.number); !lengths.empty()) {
    dash = html(" stroke-dasharray=\"{}\"", base::joined(lengths, ","));
  }
  return html(
      "<svg class=\"swatch\" viewBox=\"0 0 28 6\" aria-hidden=\"true\"><line x1=\"0\" y1=\"3\" "
      "x2=\"28\" y2=\"3\" stroke-width=\"4\" stroke=\"{}\"{}/></svg>",
      colour_of(run.number), dash);
}

Html facts_table(const std::vector<RecordedRun>& runs) {
  std::vector<std::vector<std::pair<const char*, Html>>> facts;
  facts.reserve(runs.size());
  for (const RecordedRun& run : runs) facts.push_back(facts_of(run));
  Html rows;
  for (std::size_t i = 0; i < facts.front().size(); ++i) {
    std::vector<Html> values;
    values.reserve(facts.size());
    for (const auto& of_run : facts) values.push_back(of_run[i].second);
    if (!std::ranges::all_of(values, &Html::empty)) {
      rows += run_row(Html(facts.front()[i].first), values);
    }
  }
  return run_table(runs, "", rows);
}

Html differences(const std::vector<RecordedRun>& runs) {
  if (runs.size() < 2) return {};
  std::map<std::string, std::vector<Html>> all;  // by key; one value per run
  for (const RecordedRun& run : runs) {
    Values values;
    collect(scenario::parse_yaml(run.scenario.text, run.label), "", values);
    const bool same_robot = run.scenario.robot.urdf_text == runs.front().scenario.robot.urdf_text;
    values["the URDF's links and joints"] = same_robot ? "as in " + runs.front().label : "others";
    for (const auto& [key, value] : values) {
      all.try_emplace(key, runs.size()).first->second[run.number] = Html(value);
    }
  }
  Html rows;
  for (const auto& [key, values] : all) {
    const bool same = std::ranges::all_of(values, [&values = values](const Html& value) {
      return value.markup() == values.front().markup();
    });
    if (!same) rows += run_row(html("<code>{}</code>", key), values);
  }
  const Html text = robots_text(runs);
  if (rows.empty()) return text + html("<p>The scenarios are the same.</p>\n");
  return text +
         html(
             "<p>What differs between the scenarios (–: not given), marked where it is not as in "
             "the first run:</p>\n") +
         run_table(runs, " id=\"differences\"", rows);
}

Html results_table(const std::vector<RecordedRun>& runs) {
  const bool several = runs.size() > 1;
  Html rows;
  for (const RecordedRun& run : runs) {
    if (run.tracking.num_ticks() == 0) continue;
    const Html of_run =
        several ? html("<td class=\"run\">{}{}</td>", swatch(run), run.label) : Html();
    for (std::size_t joint = 0; joint < run.tracking.joints().size(); ++joint) {
      rows += html("<tr>{}{}</tr>\n", of_run, results_row(run, joint));
    }
  }
  constexpr std::array columns = {"peak |e|", "rms e", "final e",  "decay",
                                  "peak |τ|", "rms τ", "saturated"};
  return html(
      "<div "
      "class=\"table\"><table>\n<thead><tr>{}<th scope=\"col\">Joint</th>{}</tr></thead>\n<tbody>\n"
      "{}</tbody></table></div>\n",
      several ? html("<th scope=\"col\">Run</th>") : Html(),
      each(columns,
           [](const char* column) {
             return html("<th class=\"number\" scope=\"col\">{}</th>", column);
           }),
      rows);
}

Html verdicts(const std::vector<RecordedRun>& runs) {
  return each(runs, [&](const RecordedRun& run) {
    return html("<p class=\"{}\">{}{}</p>\n", bad(run.verdict.outcome) ? "alarm" : "verdict",
                runs.size() > 1 ? html("<b>{}</b>: ", run.label) : Html(),
                text(run.verdict, run.joints));
  });
}

Html alarms(const std::vector<RecordedRun>& runs) {
  Html text;
  for (const RecordedRun& run : runs) {
    const Html of_run = runs.size() > 1 ? html("<b>{}</b>: ", run.label) : Html();
    if (run.damage.any()) {
      text += html(
          "<p class=\"alarm\">{}The log is damaged: {}. Only its readable part is shown.</p>\n",
          of_run, run.damage.text());
    }
  }
  return text;
}

}  // namespace tachless::report
