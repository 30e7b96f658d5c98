#include "report/report_tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <initializer_list>
#include <string_view>
#include <utility>
#include <variant>

#include "controller/registry.h"
#include "report/overlay.h"
#include "report/summary.h"
#include "schema/schema.h"

namespace tachless::report {
namespace {

Html bracketed(const robot::Vector& values) {
  std::vector<Html> numbers;
  for (const double value : values) numbers.push_back(number(fmt::format("{:.6g}", value)));
  return html("[{}]", joined(numbers, Html(", ")));
}

/// The name by which the scenario chooses it.
std::string_view name_of(const reference::Spec& reference) {
  return std::visit([](const auto& trajectory) { return trajectory.name; }, reference);
}

/// In the law's order; a law unknown to this version has none.
Html gains_text(const RecordedRun& run) {
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
  std::vector<Html> gains;
  for (const std::string& name : names) {
    const auto found = spec.gains.find(name);
    if (found == spec.gains.end()) continue;
    gains.push_back(html("{} = {}", name, bracketed(found->second)));
  }
  return joined(gains, Html::from_markup("<br>"));
}

Html encoder_text(const plant::EncoderSpec& encoder) {
  const auto& bits = encoder.resolution_bits;
  Html text("ideal");
  if (bits && bits->minCoeff() == bits->maxCoeff()) {
    text = Html(fmt::format("{} bit per revolution", (*bits)[0]));
  } else if (bits) {
    text = html("{} bit per revolution", bracketed(*bits));
  }
  if (encoder.noise_std_rad > 0) {
    text += html(", noise {} rad", number(fmt::format("{:.3g}", encoder.noise_std_rad)));
  }
  if (encoder.latency_ticks > 0) text += html(", {} ticks late", encoder.latency_ticks);
  return text;
}

/// An entry of a run's summary.json; null where it is not there.
nlohmann::json outcome(const RecordedRun& run, const char* key) {
  return run.outcome.is_object() ? run.outcome.value(key, nlohmann::json()) : nlohmann::json();
}

/// The same for a number, as fmt's `pattern` prints it; empty where there is none.
Html outcome_number(const RecordedRun& run, const char* key, fmt::format_string<double> pattern) {
  const nlohmann::json value = outcome(run, key);
  return value.is_number() ? number(fmt::format(pattern, value.get<double>())) : Html();
}

std::string ended_text(const RecordedRun& run) {
  if (const nlohmann::json fault = outcome(run, "fault"); fault.is_string()) {
    return fault.get<std::string>();
  }
  const std::int64_t ticks = run.summary.last_tick + 1;
  if (ticks == run.info.num_ticks) return "at its planned end";
  return fmt::format("early, after {} of {} ticks", ticks, run.info.num_ticks);
}

Html wall_text(const RecordedRun& run) {
  const Html wall = outcome_number(run, "wall_s", "{:.3g}");
  const Html rate = outcome_number(run, "real_time_factor", "{:.3g}");
  if (wall.empty()) return {};
  return rate.empty() ? html("{} s", wall) : html("{} s, {} × real time", wall, rate);
}

Html round_trip_text(const RecordedRun& run) {
  const nlohmann::json trip = outcome(run, "round_trip_us");
  std::vector<Html> parts;
  for (const auto& [key, name] : std::initializer_list<std::pair<const char*, const char*>>{
           {"p50", "median"}, {"p99", "99 %"}, {"p999", "99.9 %"}, {"max", "longest"}}) {
    if (!trip.is_object() || !trip.contains(key) || !trip[key].is_number()) continue;
    parts.push_back(html("{} {} µs", name, fmt::format("{:.0f}", trip[key].get<double>())));
  }
  return joined(parts, Html(", "));
}

Html gaps_text(const RecordedRun& run) {
  std::vector<Html> gaps;
  for (const auto& piece : run.summary.pieces) {
    if (piece.absent()) {
      gaps.push_back(html("no {}", piece.channel));
    } else if (piece.missing != 0) {
      gaps.push_back(html("{} missing in {} ticks", piece.channel, piece.missing));
    }
  }
  return gaps.empty() ? Html("none") : joined(gaps, Html("; "));
}

std::string damage_text(const RecordedRun& run) {
  if (!run.damage.any()) return "none";
  return fmt::format("{} bytes at {} places", run.damage.bytes_skipped, run.damage.stretches);
}

Html sampling_text(const RecordedRun& run) {
  const int delay = run.scenario.loop.command_delay;
  return html(
      "{}, {}, {}", short_period(run.info.period_s),
      delay == 0 ? "no delay" : fmt::format("delay of {} tick{}", delay, delay == 1 ? "" : "s"),
      run.scenario.loop.mode == experiment::Mode::lockstep ? "lockstep" : "realtime");
}

Html duration_text(const RecordedRun& run) {
  const std::int64_t ticks = run.summary.last_tick + 1;
  const double duration_s = static_cast<double>(ticks) * run.info.period_s;
  return html("{} s, {} ticks", number(fmt::format("{:.6g}", duration_s)), ticks);
}

Html payload_text(const RecordedRun& run) {
  const plant::PayloadSpec& payload = run.scenario.plant.payload;
  if (!(payload.mass_kg > 0)) return {};
  Html text =
      html("{} kg, unknown to the controller", number(fmt::format("{:.4g}", payload.mass_kg)));
  if (payload.attach_s > 0) text += html(", from {} s on", fmt::format("{:g}", payload.attach_s));
  if (payload.release_s) text += html(", until {} s", fmt::format("{:g}", *payload.release_s));
  return text;
}

Html robot_text(const RecordedRun& run) {
  return html("{}, {} {} joints", run.scenario.robot.name, run.scenario.num_joints,
              run.scenario.robot.flexible ? "flexible" : "rigid");
}

Html stiffness_text(const RecordedRun& run) {
  const auto& flexible = run.scenario.robot.flexible;
  return flexible ? html("{} N m/rad", bracketed(flexible->stiffness)) : Html();
}

Html torque_limit_text(const RecordedRun& run) {
  const auto& limit = run.scenario.plant.drive.torque_limit_Nm;
  return limit ? html("{} N m", bracketed(*limit)) : Html("none");
}

/// Of a law that logs a filter's output, nu.
Html filter_fact(const RecordedRun& run) {
  const bool has_filter =
      std::any_of(run.signals.begin(), run.signals.end(),
                  [](const LoggedSignal& signal) { return signal.name.starts_with("nu"); });
  return has_filter ? Html(schema::name_of(run.scenario.controller.filter)) : Html();
}

Html lead_text(const RecordedRun& run) {
  const bool none = run.scenario.controller.feedforward_lead == experiment::FeedforwardLead::none;
  return Html(none ? "none" : "half a tick plus delay");
}

Html realtime_number(const RecordedRun& run, const char* key) {
  return run.scenario.loop.mode == experiment::Mode::realtime ? outcome_number(run, key, "{:.0f}")
                                                              : Html();
}

/// A row: its name, and its value of a run; empty where the run has none.
using Fact = std::pair<const char*, std::function<Html(const RecordedRun&)>>;

const std::vector<Fact>& facts() {
  using Run = RecordedRun;
  static const std::vector<Fact> all = {
      {"Scenario", [](const Run& run) { return Html(run.scenario.name); }},
      {"Log", [](const Run& run) { return html("<code>{}</code>", run.log.string()); }},
      {"Run",
       [](const Run& run) {
         return html("{}, recorded by tachless {}", run.run_id, run.info.version);
       }},
      {"Robot", robot_text},
      {"Stiffness", stiffness_text},
      {"Payload", payload_text},
      {"Law", [](const Run& run) { return Html(run.scenario.controller.law_text()); }},
      {"Measured", [](const Run& run) { return html("<code>{}</code>", run.info.measurement); }},
      {"Gains", gains_text},
      {"Filter", filter_fact},
      {"Feed-forward lead", lead_text},
      {"Reference", [](const Run& run) { return Html(name_of(run.scenario.reference)); }},
      {"Sampling", sampling_text},
      {"Encoder", [](const Run& run) { return encoder_text(run.scenario.plant.encoder); }},
      {"Torque limit", torque_limit_text},
      {"Duration", duration_text},
      {"Ended", [](const Run& run) { return Html(ended_text(run)); }},
      {"Gaps in the log", gaps_text},
      {"Damage to the log", [](const Run& run) { return Html(damage_text(run)); }},
      {"Wall-clock time", wall_text},
      {"Round trip", round_trip_text},
      {"Missed commands", [](const Run& run) { return realtime_number(run, "missed_commands"); }},
      {"Missed deadlines", [](const Run& run) { return realtime_number(run, "missed_deadlines"); }},
  };
  return all;
}

Html results_row(const RecordedRun& run, std::size_t joint) {
  const study::JointTracking& signals = run.tracking.joints()[joint];
  const std::string& length = run.joints.length[joint];
  const std::string& effort = run.joints.effort[joint];
  const double share = 100 * static_cast<double>(run.saturated[joint].ticks()) /
                       static_cast<double>(run.tracking.num_ticks());
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
  row += cell(fmt::format("{:.3g}", share), "%");
  return row;
}

}  // namespace

Html swatch(std::size_t run) {
  Html dash;
  if (const std::string text = dash_of(run); !text.empty()) {
    dash = html(" stroke-dasharray=\"{}\"", text.substr(1, text.size() - 2));
  }
  return html(
      "<svg class=\"swatch\" viewBox=\"0 0 28 6\" aria-hidden=\"true\"><line x1=\"0\" y1=\"3\" "
      "x2=\"28\" y2=\"3\" stroke-width=\"4\" stroke=\"{}\"{}/></svg>",
      colour_of(run), dash);
}

Html run_headings(const std::vector<RecordedRun>& runs) {
  Html head;
  for (std::size_t i = 0; runs.size() > 1 && i < runs.size(); ++i) {
    head += html("<th scope=\"col\">{}{}</th>", swatch(i), runs[i].label);
  }
  return head.empty() ? head : html("<thead><tr><td></td>{}</tr></thead>\n", head);
}

Html facts_table(const std::vector<RecordedRun>& runs) {
  Html rows;
  for (const auto& [name, value] : facts()) {
    const Html first = value(runs.front());
    Html cells;
    bool any = false;
    for (const RecordedRun& run : runs) {
      const Html cell = value(run);
      any = any || !cell.empty();
      const char* marked = cell.markup() == first.markup() ? "" : " class=\"differs\"";
      cells += html("<td{}>{}</td>", Html::from_markup(marked), cell.empty() ? Html("–") : cell);
    }
    if (any) rows += html("<tr><th scope=\"row\">{}</th>{}</tr>\n", name, cells);
  }
  return html("<div class=\"table\"><table class=\"facts\">\n{}<tbody>\n{}</tbody></table></div>\n",
              run_headings(runs), rows);
}

Html results_table(const std::vector<RecordedRun>& runs) {
  const bool several = runs.size() > 1;
  Html head;
  if (several) head += html("<th scope=\"col\">Run</th>");
  head += html("<th scope=\"col\">Joint</th>");
  for (const char* column :
       {"peak |e|", "rms e", "final e", "decay", "peak |τ|", "rms τ", "saturated"}) {
    head += html("<th class=\"number\" scope=\"col\">{}</th>", column);
  }
  Html rows;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const RecordedRun& run = runs[i];
    if (run.tracking.num_ticks() == 0) continue;
    const Html who = several ? html("<td class=\"run\">{}{}</td>", swatch(i), run.label) : Html();
    for (std::size_t joint = 0; joint < run.tracking.joints().size(); ++joint) {
      rows += html("<tr>{}{}</tr>\n", who, results_row(run, joint));
    }
  }
  return html(
      "<div "
      "class=\"table\"><table>\n<thead><tr>{}</tr></thead>\n<tbody>\n{}</tbody></table></div>\n",
      head, rows);
}

Html alarms(const std::vector<RecordedRun>& runs) {
  Html text;
  for (const RecordedRun& run : runs) {
    const Html who = runs.size() > 1 ? html("<b>{}</b>: ", run.label) : Html();
    if (outcome(run, "fault").is_string() || run.summary.last_tick + 1 != run.info.num_ticks) {
      text += html("<p class=\"alarm\">{}The run ended {}.</p>\n", who, ended_text(run));
    }
    if (run.damage.any()) {
      text += html(
          "<p class=\"alarm\">{}The log is damaged: {} are no events. What is intact is "
          "shown.</p>\n",
          who, damage_text(run));
    }
  }
  return text;
}

}  // namespace tachless::report
