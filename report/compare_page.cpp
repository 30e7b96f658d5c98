#include "report/compare_page.h"

#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>

#include "diagnostics/file_text.h"
#include "diagnostics/json_text.h"
#include "diagnostics/text.h"
#include "report/chart.h"
#include "report/figure.h"
#include "report/html.h"

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

/// A curve for each law.
Chart chart_of(const std::vector<ComparedLaw>& laws, study::Envelope study::Compared::*signal,
               const Label& label, bool named) {
  Chart chart;
  chart.y_label = label;
  chart.wide = true;
  for (const auto& [result, overrides] : laws) {
    const std::size_t i = chart.curves.size();
    chart.curves.push_back({words(named ? result.law : ""), (result.*signal).points(1000),
                            colour_of(i), 1.4, dash_of(i)});
  }
  return chart;
}

Html html_table(const std::vector<ComparedLaw>& laws) {
  const auto head = [](const Column& column) {
    return html("<th class=\"number\">{}<br>{}</th>", column.heading, column.unit);
  };
  const auto row = [](const ComparedLaw& law) {
    const Compared& result = law.result;
    return html("<tr><th>{}</th><td>{}</td><td>{}</td>{}</tr>\n", result.law, result.measures,
                result.run.outcome(), each(columns(), [&](const Column& column) {
                  return html("<td class=\"number\">{}</td>", shown(column, result));
                }));
  };
  return html(
      "<div "
      "class=\"table\"><table><thead><tr><th>law</th><th>measures</th><th>outcome</th>{}</tr></"
      "thead>\n<tbody>{}</tbody></table></div>\n",
      each(columns(), head), each(laws, row));
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
  // Errors above torques, the laws' names once.
  Chart errors = chart_of(laws, &Compared::error, {"e", "", "", "rad; m", true}, true);
  make_logarithmic(errors);
  const Chart torques = chart_of(laws, &Compared::torque, {"τ", "", "", "N m; N", true}, false);
  const Figure drawing{scenario.name, {errors, torques}};
  write_figure(drawing, directory / "compare.svg", study_remedy);
  const Html figure =
      html("<figure>{}</figure>\n", inline_svg(drawing, "Errors and torques of all laws"));
  diagnostics::UnfinishedFile(directory / "compare.json", study_remedy)
      .write(diagnostics::json_text(to_json(laws), 1) + "\n");
  const Html gains = each(laws, [](const ComparedLaw& law) {
    return html(
        "<li>{}: <code>{}</code></li>\n", law.result.law,
        law.overrides.empty() ? "as in the scenario" : diagnostics::joined(law.overrides, "; "));
  });
  write_study_page(directory / "index.html", "Laws compared: " + scenario.name,
                   html("<p class=\"lead\">{}</p>\n{}{}<h2>Gains</h2>\n<ul>{}</ul>\n", rule,
                        html_table(laws), figure, gains),
                   scenario.text);
}

}  // namespace tachless::report
