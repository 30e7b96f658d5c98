#include "report/compare_page.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>

#include "diagnostics/json_text.h"
#include "diagnostics/text.h"
#include "diagnostics/unfinished_file.h"
#include "report/chart.h"
#include "report/gnuplot.h"
#include "report/plain_page.h"

namespace tachless::report {
namespace {

using study::Compared;

/// A column of numbers of the table.
struct Column {
  std::string_view key, heading, unit;
  std::function<std::optional<double>(const Compared&)> value;
  double scale = 1;  ///< of what people see
};

const std::vector<Column>& columns() {
  static const std::vector<Column> all = {
      {"peak_error", "peak error", "rad", [](const Compared& c) { return c.run.peak_error; }},
      {"rms_error", "rms error", "rad", [](const Compared& c) { return c.run.rms_error; }},
      {"settled_error", "settled", "rad", [](const Compared& c) { return c.run.settled_error; }},
      {"least_settled_error", "least", "rad",
       [](const Compared& c) { return c.least_settled_error; }},
      {"largest_settled_error", "largest", "rad",
       [](const Compared& c) { return c.largest_settled_error; }},
      {"torque_rms", "torque rms", "N m", [](const Compared& c) { return c.run.torque_rms; }},
      {"torque_variation", "variation", "N m/s",
       [](const Compared& c) { return c.run.torque_variation; }},
      {"energy", "energy", "J", [](const Compared& c) { return c.run.energy; }},
      {"noise_amplification", "noise", "N m/rad",
       [](const Compared& c) { return c.noise_amplification; }},
      {"largest_period_s", "h max", "ms", [](const Compared& c) { return c.largest_period_s; },
       1e3},
      {"step_us", "step", "µs", [](const Compared& c) { return c.step_us; }}};
  return all;
}

std::string shown(const Column& column, const Compared& compared) {
  const auto value = column.value(compared);
  return value && std::isfinite(*value) ? fmt::format("{:.3g}", *value * column.scale) : "-";
}

/// gnuplot's commands for one diagram with a curve for each law.
std::string diagram(const std::vector<ComparedLaw>& laws, const study::Envelope Compared::*signal,
                    const char* label) {
  constexpr std::array<const char*, 3> dashes = {"1", "(8,4)", "(2,3)"};
  std::string data;
  std::vector<std::string> plots;
  plots.reserve(laws.size());
  for (std::size_t i = 0; i < laws.size(); ++i) {
    data += fmt::format("$law{} << EOD\n", i);
    for (const study::Point& point : (laws[i].result.*signal).points(1000)) {
      data += fmt::format("{:.8g} {:.6g}\n", point.x, point.y);
    }
    data += "nan nan\nEOD\n";
    plots.push_back(fmt::format("$law{} with lines lw 1.4 dashtype {} lc rgb '{}' title {}", i,
                                dashes[i / palette.size() % dashes.size()],
                                palette[i % palette.size()], gnuplot_text(laws[i].result.law)));
  }
  return data + fmt::format("set ylabel '{}'\nplot {}\n", label, fmt::join(plots, ", "));
}

/// Errors above torques, the laws' names once, beside them.
std::string figure_commands(const std::vector<ComparedLaw>& laws, const std::string& title,
                            const std::filesystem::path& svg) {
  std::vector<Curve> errors(laws.size());
  for (std::size_t i = 0; i < laws.size(); ++i) errors[i].points = laws[i].result.error.points();
  const double floor = logarithmic_floor(errors).value_or(1e-12);
  return fmt::format(
             "set terminal svg size 1064,760 font 'sans,13' background '#ffffff'\nset encoding "
             "utf8\nset output {}\nset multiplot layout 2,1 title {}\nset border 3\nset tics "
             "nomirror\nset grid lc rgb '#dddddd'\nset lmargin at screen 0.09\nset rmargin at "
             "screen 0.76\nset key at screen 0.78,0.92 left top vertical Left reverse samplen 2\n"
             "set logscale y\nset format y '10^{{%T}}'\nset yrange [{:.3g}:*]\n",
             gnuplot_string(svg.string()), gnuplot_text(title), floor) +
         diagram(laws, &Compared::error, "|e| [rad; m]") +
         "unset logscale y\nset format y '%g'\nset yrange [0:*]\nunset key\nset xlabel 'time "
         "[s]'\n" +
         diagram(laws, &Compared::torque, "|τ| [N m; N]") + "unset multiplot\n";
}

Html html_table(const std::vector<ComparedLaw>& laws) {
  Html head, body;
  for (const Column& column : columns()) {
    head += html("<th class=\"number\">{}<br>{}</th>", column.heading, column.unit);
  }
  for (const auto& [result, overrides] : laws) {
    Html cells;
    for (const Column& column : columns()) {
      cells += html("<td class=\"number\">{}</td>", shown(column, result));
    }
    body += html("<tr><th>{}</th><td>{}</td><td>{}</td>{}</tr>\n", result.law, result.measures,
                 result.run.outcome(), cells);
  }
  return html(
      "<div class=\"table\"><table><thead><tr><th>law</th><th>measures</th><th>outcome</th>{}"
      "</tr></thead>\n<tbody>{}</tbody></table></div>\n",
      head, body);
}

}  // namespace

std::string comparison_table(const std::vector<ComparedLaw>& laws) {
  std::size_t width = 3;
  for (const ComparedLaw& law : laws) width = std::max(width, law.result.law.size());
  std::string text = fmt::format("  {:<{}}  {:<14} {:<12}", "law", width, "measures", "outcome");
  std::string units(text.size(), ' ');
  for (const Column& column : columns()) {
    text += fmt::format(" {:>10}", column.heading);
    units += fmt::format(" {:>10}", column.unit);
  }
  text += "\n" + units + "\n";
  for (const ComparedLaw& law : laws) {
    const Compared& result = law.result;
    text += fmt::format("  {:<{}}  {:<14} {:<12}", result.law, width, result.measures,
                        result.run.outcome());
    for (const Column& column : columns()) text += fmt::format(" {:>10}", shown(column, result));
    text += "\n";
  }
  return text;
}

nlohmann::ordered_json to_json(const std::vector<ComparedLaw>& laws) {
  auto json = nlohmann::ordered_json::array();
  for (const auto& [result, overrides] : laws) {
    nlohmann::ordered_json law = {{"law", result.law},
                                  {"measures", result.measures},
                                  {"set", overrides},
                                  {"outcome", result.run.outcome()}};
    for (const Column& column : columns()) {
      const auto value = column.value(result);
      law[std::string(column.key)] =
          value && std::isfinite(*value) ? nlohmann::ordered_json(*value) : nullptr;
    }
    if (!result.run.stopped.empty()) law["stopped"] = result.run.stopped;
    json.push_back(law);
  }
  return json;
}

void write_comparison(const experiment::Scenario& scenario, const std::string& rule,
                      const std::vector<ComparedLaw>& laws,
                      const std::filesystem::path& directory) {
  const Html figure = drawn_figure(
      directory / "compare.svg",
      [&](const auto& svg) { return figure_commands(laws, scenario.name, svg); },
      "Errors and torques of all laws");
  diagnostics::UnfinishedFile(directory / "compare.json", "name another directory with --out")
      .write(diagnostics::json_text(to_json(laws), 1) + "\n");
  Html gains;
  for (const auto& [result, overrides] : laws) {
    gains += html("<li>{}: <code>{}</code></li>\n", result.law,
                  overrides.empty() ? "as in the scenario" : diagnostics::joined(overrides, "; "));
  }
  write_plain_page(directory / "index.html", "Laws compared: " + scenario.name,
                   html("<p class=\"lead\">{}</p>\n{}{}<h2>Gains</h2>\n<ul>{}</ul>\n", rule,
                        html_table(laws), figure, gains),
                   scenario.text);
}

}  // namespace tachless::report
