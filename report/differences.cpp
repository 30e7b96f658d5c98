#include "report/differences.h"

#include <algorithm>
#include <map>
#include <string>

#include "diagnostics/text.h"
#include "experiment/yaml_tree.h"
#include "report/report_tables.h"

namespace tachless::report {
namespace {

using Values = std::map<std::string, std::string>;  // "loop.period_s" -> "1.0e-3"

void collect(const experiment::YamlNode& node, const std::string& key, Values& values) {
  if (node.kind != experiment::YamlNode::Kind::map) {
    values[key] = experiment::emit_yaml(node);
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

/// Of joints that the first run's robot has not, or has alone.
Html robots_text(const std::vector<RecordedRun>& runs) {
  const std::vector<std::string>& first = runs.front().joints.name;
  Html text;
  for (const RecordedRun& run : runs) {
    const std::vector<std::string>& names = run.joints.name;
    if (names == first) continue;
    const auto listed = [](const std::vector<std::string>& joints) {
      return joints.empty() ? "no joint" : diagnostics::joined(joints);
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

Html differences(const std::vector<RecordedRun>& runs) {
  if (runs.size() < 2) return {};
  std::vector<Values> scenarios;
  Values all;
  for (const RecordedRun& run : runs) {
    scenarios.emplace_back();
    collect(experiment::parse_yaml(run.scenario.text, run.label), "", scenarios.back());
    const bool same_robot = run.scenario.robot.urdf_text == runs.front().scenario.robot.urdf_text;
    scenarios.back()["the URDF's links and joints"] =
        same_robot ? "as in " + runs.front().label : "others";
    all.insert(scenarios.back().begin(), scenarios.back().end());
  }
  Html rows;
  for (const auto& [key, unused] : all) {
    const auto given = [&key = key](const Values& values) {
      const auto found = values.find(key);
      return found == values.end() ? std::string("–") : found->second;
    };
    const std::string first = given(scenarios.front());
    Html cells;
    bool differs = false;
    for (const Values& scenario : scenarios) {
      const bool other = given(scenario) != first;
      differs = differs || other;
      cells += html("<td{}>{}</td>", Html::from_markup(other ? " class=\"differs\"" : ""),
                    given(scenario));
    }
    if (differs) rows += html("<tr><th scope=\"row\"><code>{}</code></th>{}</tr>\n", key, cells);
  }
  const Html text = robots_text(runs);
  if (rows.empty()) return text + html("<p>The scenarios are the same.</p>\n");
  return text + html(
                    "<p>What differs between the scenarios (–: not given), marked where it is not "
                    "as in the first run:</p>\n<div class=\"table\"><table class=\"facts\" "
                    "id=\"differences\">\n{}<tbody>\n{}</tbody></table></div>\n",
                    run_headings(runs), rows);
}

}  // namespace tachless::report
