#include "report/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <string_view>

#include "base/file_text.h"
#include "base/json_text.h"
#include "base/logging.h"
#include "base/text.h"
#include "base/version.h"
#include "logger/tick_messages.h"
#include "report/page_files.h"
#include "report/summary.h"
#include "robot/model.h"

namespace tachless::report {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view remedy = "free some space, or name another place";

std::string base64(const std::vector<float>& values) {
  static_assert(std::endian::native == std::endian::little);
  return report::base64(
      {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float)});
}

nlohmann::json curve_of(const Curve& curve) {
  std::vector<float> values;
  for (const study::Point& point : curve.points) {
    // Not a number makes a gap. An infinite value would make the axis infinite.
    const bool drawn = std::abs(point.y) <= std::numeric_limits<float>::max();
    values.insert(values.end(),
                  {static_cast<float>(point.x), drawn ? static_cast<float>(point.y) : NAN});
  }
  const Html name = curve.label.empty() ? Html(curve.signal) : html_of(curve.label);
  return {{"name", name.markup()},   {"signal", curve.signal}, {"run", curve.run},
          {"colour", curve.colour},  {"width", curve.width},   {"dash", curve.dash},
          {"points", base64(values)}};
}

nlohmann::json chart_of(const Chart& chart) {
  nlohmann::json range, curves = nlohmann::json::array(), marks = nlohmann::json::array();
  if (chart.y_range) range = {chart.y_range->first, chart.y_range->second};
  for (const Curve& curve : chart.curves) {
    if (!curve.points.empty()) curves.push_back(curve_of(curve));
  }
  for (const Mark& mark : chart.marks) marks.push_back({mark.from, mark.to, mark.colour});
  return {{"name", chart.name},
          {"label", html_of(chart.y_label).markup()},
          {"note", Html(chart.note).markup()},
          {"logarithmic", chart.logarithmic_y},
          {"y_axis", !chart.named_rows},
          {"range", range},
          {"levels", chart.levels},
          {"marks", marks},
          {"curves", curves}};
}

nlohmann::json rows(const Eigen::Matrix3d& R) {
  const Eigen::Matrix3d stored = R.transpose();  // Eigen stores columns
  return std::vector<double>(stored.data(), stored.data() + 9);
}

/// Returns the points to which the link of `body` (-1: the ground) is drawn from its origin. The
/// points are the joints of its children and the ends of the tree. If there are none, the point is
/// twice as far as the centre of mass.
nlohmann::json ends_of(const robot::Model& model, int body) {
  nlohmann::json ends = nlohmann::json::array();
  for (const robot::Body& other : model.bodies) {
    if (other.parent == body) ends.push_back(base::json_list<nlohmann::json>(other.p_PB));
  }
  for (const auto& [name, frame] : model.frames) {
    if (frame.body == body && frame.leaf)
      ends.push_back(base::json_list<nlohmann::json>(frame.p_BF));
  }
  if (ends.empty())
    ends.push_back(
        base::json_list<nlohmann::json>(2 * model.bodies[static_cast<std::size_t>(body)].p_Bcm));
  return ends;
}

nlohmann::json robot_of(const Overlay& all, const RecordedRun& run) {
  const robot::Model& model = *run.scenario.model;
  nlohmann::json bodies = nlohmann::json::array(), tools = nlohmann::json::array(),
                 links = nlohmann::json::object();
  for (int k = 0; k < static_cast<int>(model.bodies.size()); ++k) {
    const robot::Body& body = model.bodies[static_cast<std::size_t>(k)];
    bodies.push_back({{"parent", body.parent},
                      {"R", rows(body.R_PB)},
                      {"p", base::json_list<nlohmann::json>(body.p_PB)},
                      {"axis", base::json_list<nlohmann::json>(body.axis_B)},
                      {"prismatic", body.type == robot::JointType::prismatic},
                      {"joint", body.coordinate},
                      {"multiplier", body.multiplier},
                      {"offset", body.offset},
                      {"ends", ends_of(model, k)}});
  }
  for (const std::string& link : robot::farthest_leaves(model)) {
    const robot::Frame& frame = model.frames.at(link);
    tools.push_back({{"body", frame.body}, {"p", base::json_list<nlohmann::json>(frame.p_BF)}});
  }
  for (const auto& [name, frame] : model.frames) {
    links[name] = {{"body", frame.body},
                   {"R", rows(frame.R_BF)},
                   {"p", base::json_list<nlohmann::json>(frame.p_BF)}};
  }
  std::vector<std::size_t> joints(run.joints.name.size());
  for (std::size_t joint = 0; joint < all.joints.size(); ++joint) {
    if (const auto own = all.joint_of(run, joint)) joints[*own] = joint;
  }
  return {{"number", run.number}, {"label", Html(run.label).markup()},
          {"bodies", bodies},     {"colour", colour_of(run.number)},
          {"tools", tools},       {"ends", ends_of(model, -1)},
          {"joints", joints},     {"urdf", run.visuals.urdf},
          {"links", links},       {"meshes", run.visuals.meshes}};
}

Html script(const std::string& text) {
  return Html::from_markup("<script>\n" + text + "\n</script>\n");
}

/// Returns a figure: an element for the script to draw in if the chart is over time, otherwise a
/// drawing.
Html figure(Chart chart) {
  const Html caption =
      chart.heading.empty() ? Html() : html("<figcaption>{}</figcaption>", chart.heading);
  if (chart.over_time) {
    return html(
        "<figure id=\"{}\" class=\"live{}\" aria-label=\"{}\">{}<div "
        "class=\"panel\"></div></figure>\n",
        chart.name, chart.wide ? " wide" : "", chart.caption, caption);
  }
  chart.heading.clear();
  return html("<figure id=\"{}\">{}{}</figure>\n", chart.name, caption,
              inline_svg({"", {chart}, 1, 520}, chart.caption));
}

Html title_of(const std::vector<RecordedRun>& runs) {
  if (runs.size() == 1) {
    return html("{}: {}, h = {}", runs[0].scenario.name, runs[0].scenario.controller.law_text(),
                base::period_text(runs[0].info.period_s));
  }
  std::vector<Html> labels;
  labels.reserve(runs.size());
  for (const RecordedRun& run : runs) labels.emplace_back(run.label);
  return joined(labels, Html(" · "));
}

/// Returns the figure of each run for a page whose scripts do not run.
Html tracking_figures(const std::vector<RecordedRun>& runs) {
  constexpr std::size_t max_points = 500;  // each reader of the page downloads them
  return each(runs, [&](const RecordedRun& run) {
    if (run.tracking.num_ticks() == 0) return Html();
    return html(
        "<figure class=\"wide\">{}</figure>\n",
        inline_svg(tracking_figure(run.tracking, run.label, run.end_s(), run.joints, max_points),
                   "Positions, errors and torques over time: " + run.label));
  });
}

/// Returns the tables of the recorded results, with figures if no script draws.
Html results(const std::vector<RecordedRun>& runs, bool scripted) {
  const Html figures = tracking_figures(runs);
  return html(
      "<section id=\"facts\"><h2>Run facts</h2>\n{}{}</section>\n<section "
      "id=\"results\"><h2>Results</h2>\n<p>Errors are measured minus reference; torques as "
      "applied.</p>\n{}{}</section>\n",
      facts_table(runs), differences(runs), results_table(runs),
      scripted ? html("<noscript>{}</noscript>", figures) : figures);
}

Html lead_of(const Overlay& all) {
  if (all.live) {
    return html(
        "A run of <a href=\"/\">{}</a> that goes on: its messages as they are on the bus, not "
        "verified. The newest minute is kept.",
        all.runs[0].info.robot);
  }
  return html("Recorded position, torque and controller signals of {} of the loop, tick by tick.",
              all.alone() ? "one run" : fmt::format("{} runs", all.runs.size()));
}

Html points_text(const Overlay& all) {
  if (all.live) return Html("A curve has the lowest and the highest value of each 25 ms.");
  return html(
      "A curve has up to {} points: in a run of more than half as many ticks, the lowest and the "
      "highest value of equal stretches.",
      all.budget);
}

Html footer_of(const Overlay& all) {
  if (all.live) return html("Served by tachless {}, to this computer alone.", base::version);
  return html(
      "Written by tachless {}. The controller's commands can be computed again from the log: "
      "<code>tachless replay {}</code>",
      base::version, all.runs.front().log.string());
}

/// Returns the scripts of the page `page` with their data. If a library is missing, warns and
/// returns nothing.
Html scripts_of(const std::string& page, const Libraries& libraries, const Overlay& all,
                const std::vector<ReportSection>& sections) {
  if (!libraries.missing.empty()) {
    base::log_warning(
        "{} has no charts that move, because {} cannot be read; type: apt-get install "
        "libjs-dygraphs libjs-three",
        page, libraries.missing);
    return {};
  }
  const bool meshes = std::ranges::any_of(
      all.runs, [](const RecordedRun& run) { return !run.visuals.meshes.empty(); });
  return libraries.scripts + (meshes ? libraries.mesh_readers : Html()) +
         Html::from_markup("<script type=\"application/json\" id=\"data\">" +
                           page_data(all, sections) + "</script>\n") +
         script(page_js) + script(robot_js);
}

}  // namespace

std::string report_page(const Overlay& all, const std::vector<ReportSection>& sections,
                        const Html& scripts) {
  const std::vector<RecordedRun>& runs = all.runs;
  const Html legend = each(runs, [](const RecordedRun& run) {
    return html("<span>{}{}</span> ", swatch(run), run.label);
  });
  Html contents, shown;
  for (const ReportSection& section : sections) {
    contents += html("<a href=\"#{}\">{}</a>", section.name, section.heading);
    const Html charts = each(section.charts, figure);
    Html before;
    if (charts.empty() && !section.without.empty()) before = html("<p>{}</p>\n", section.without);
    if (!charts.empty() && section.name != "events" && runs.size() > 1) {
      before = html("<p class=\"legend\">{}</p>\n", legend);
    }
    shown +=
        html("<section id=\"{}\"><h2>{}</h2>\n{}\n{}<div class=\"charts\">\n{}</div>\n</section>\n",
             section.name, section.heading, section.text, before, charts);
  }
  // The scenario of a single run is open on the page, and therefore on paper. The scenarios of
  // several runs are folded, because a table lists their differences.
  const Html scenarios = each(runs, [&](const RecordedRun& run) {
    return html("<details{}><summary>{}</summary><pre>{}</pre></details>\n",
                runs.size() == 1 ? " open" : "", run.label, run.info.scenario);
  });
  const Html title = title_of(runs);
  const Html none;
  return fmt::format(
      fmt::runtime(page_html), fmt::arg("title", title.markup()), fmt::arg("style", page_css),
      fmt::arg("connect", all.live ? "; connect-src 'self'" : ""),
      fmt::arg("lead", lead_of(all).markup()),
      fmt::arg("verdicts", (all.live ? none : verdicts(runs)).markup()),
      fmt::arg("alarms", (all.live ? none : alarms(runs)).markup()),
      fmt::arg("contents", contents.markup()), fmt::arg("points", points_text(all).markup()),
      fmt::arg("path", all.live ? "" : "; the line: where the tool goes"),
      fmt::arg("scripts", scripts.markup()),
      fmt::arg("results", (all.live ? none : results(runs, !scripts.empty())).markup()),
      fmt::arg("sections", shown.markup()), fmt::arg("scenarios", scenarios.markup()),
      fmt::arg("footer", footer_of(all).markup()));
}

std::string page_data(const Overlay& all, const std::vector<ReportSection>& sections) {
  nlohmann::json charts = nlohmann::json::array(), runs = nlohmann::json::array();
  for (const ReportSection& section : sections) {
    for (const Chart& chart : section.charts) {
      if (chart.over_time) charts.push_back(chart_of(chart));
    }
  }
  for (const RecordedRun& run : all.runs) runs.push_back(robot_of(all, run));
  std::string text = base::json_text(
      nlohmann::json{{"end_s", all.end_s},
                     {"live", all.live ? nlohmann::json(all.runs[0].run_id) : nlohmann::json()},
                     {"robot", all.runs[0].info.robot},
                     {"runs", runs},
                     {"charts", charts}});
  for (std::size_t at = 0; (at = text.find('<', at)) != std::string::npos;) {
    text.replace(at, 1, "\\u003c");
  }
  return text;
}

Libraries read_libraries(const std::filesystem::path& root) {
  Libraries libraries;
  for (const char* name :
       {"dygraphs/dygraph.min.js", "three/three.min.js",
        "three/examples/js/controls/OrbitControls.js", "three/examples/js/loaders/STLLoader.js",
        "three/examples/js/loaders/OBJLoader.js", "three/examples/js/loaders/ColladaLoader.js"}) {
    const auto text = base::file_text(root / name);
    // A file that would end the script element early is not the library of Debian.
    if (!text || text->find("</script") != std::string::npos) {
      return {{}, (root / name).string(), {}};
    }
    const bool reader = std::string_view(name).find("loaders") != std::string_view::npos;
    (reader ? libraries.mesh_readers : libraries.scripts) += script(*text);
  }
  return libraries;
}

std::string live_page(const logger::RunDescription& described, const Visuals& visuals,
                      const Libraries& libraries) {
  std::vector<RecordedRun> runs;
  RecordedRun& run = runs.emplace_back(described);
  run.visuals = visuals;
  // One tick with nonzero values, so every chart has its curves. The page receives their points
  // later.
  const Vector one = Vector::Ones(run.layout.num_joints);
  run.tracking.add(0, one, 0 * one, run.layout.num_motors > 0 ? one : Vector(), one);
  for (LoggedSignal& signal : run.signals) {
    for (study::Envelope& joint : signal.joints) joint.add(0, 1);
  }
  if (logger::has_slot(run.scenario, logger::Slot::contact)) run.contact_force.add(0, 1);
  run.decay.resize(run.joints.name.size());
  Overlay all(runs);
  all.live = true;
  std::vector<ReportSection> sections = report_sections(all);
  std::erase_if(sections, [](const ReportSection& section) {
    return std::ranges::none_of(section.charts, &Chart::over_time) || section.name == "events";
  });
  return report_page(all, sections, scripts_of("the live page", libraries, all, sections));
}

void write_report(const std::vector<RecordedRun>& runs, const fs::path& html,
                  const Libraries& libraries) {
  base::UnfinishedFile page(html, remedy);
  const Overlay all(runs);
  const std::vector<ReportSection> sections = report_sections(all);
  page.write(report_page(all, sections, scripts_of(html.string(), libraries, all, sections)));
}

}  // namespace tachless::report
