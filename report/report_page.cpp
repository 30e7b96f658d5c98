#include "report/report_page.h"

#include <fmt/format.h>

#include "diagnostics/version.h"
#include "report/differences.h"
#include "report/page_files.h"
#include "report/report_tables.h"
#include "report/summary.h"

namespace tachless::report {
namespace {

Html legend(const std::vector<RecordedRun>& runs) {
  Html names;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    names += html("<span>{}{}</span> ", swatch(i), runs[i].label);
  }
  return runs.size() < 2 ? Html() : html("<p class=\"legend\">{}</p>\n", names);
}

Html drawing(const Drawings& drawings, const std::string& name, const Chart& chart) {
  const auto found = drawings.find(name);
  if (found == drawings.end()) return html("<p>{} (not drawn)</p>", chart.caption);
  return inline_svg(found->second, name + "-", chart.caption);
}

Html figure(const ReportChart& report, const Drawings& drawings) {
  const Chart& chart = report.chart;
  const Html caption =
      report.heading.empty() ? Html() : html("<figcaption>{}</figcaption>", report.heading);
  return html("<figure id=\"{}\"{}>{}<div class=\"still\">{}</div>{}</figure>\n", chart.name,
              Html::from_markup(chart.wide ? " class=\"wide\"" : ""), caption,
              drawing(drawings, chart.name, chart),
              Html::from_markup(chart.over_time() ? "<div class=\"live\"></div>" : ""));
}

Html section_html(const ReportSection& section, const std::vector<RecordedRun>& runs,
                  const Drawings& drawings) {
  Html charts;
  for (const ReportChart& chart : section.charts) charts += figure(chart, drawings);
  Html before;
  if (section.charts.empty() && !section.without.empty()) {
    before = html("<p>{}</p>\n", section.without);
  }
  if (!section.charts.empty() && section.name != "events") before = legend(runs);
  return html(
      "<section id=\"{}\"><h2>{}</h2>\n{}\n{}<div class=\"charts\">\n{}</div>\n</section>\n",
      section.name, section.heading, section.text, before, charts);
}

Html title_of(const std::vector<RecordedRun>& runs) {
  if (runs.size() == 1) {
    return html("{}: {}, h = {}", runs[0].scenario.name, runs[0].scenario.controller.law_text(),
                short_period(runs[0].info.period_s));
  }
  std::vector<Html> labels;
  labels.reserve(runs.size());
  for (const RecordedRun& run : runs) labels.emplace_back(run.label);
  return joined(labels, Html(" · "));
}

}  // namespace

std::vector<Chart> drawn_charts(const std::vector<ReportSection>& sections) {
  std::vector<Chart> charts;
  for (const ReportSection& section : sections) {
    for (const ReportChart& report : section.charts) charts.push_back(report.chart);
  }
  return charts;
}

std::string report_page(const std::vector<RecordedRun>& runs,
                        const std::vector<ReportSection>& sections, const Drawings& drawings,
                        const Html& scripts) {
  Html contents, shown, scenarios;
  for (const ReportSection& section : sections) {
    contents += html("<a href=\"#{}\">{}</a>", section.name, section.heading);
    shown += section_html(section, runs, drawings);
  }
  for (const RecordedRun& run : runs) {
    // Of one run it is on the page, and on paper; of several the differences are in the table.
    scenarios += html("<details{}><summary>{}</summary><pre>{}</pre></details>\n",
                      runs.size() == 1 ? " open" : "", run.label, run.info.scenario);
  }
  const Html title = title_of(runs);
  return filled(page_html,
                {{"title", title},
                 {"style", Html::from_markup(page_css)},
                 {"heading", title},
                 {"runs", Html(runs.size() == 1 ? "one run" : fmt::format("{} runs", runs.size()))},
                 {"alarms", alarms(runs)},
                 {"contents", contents},
                 {"points", Html(std::to_string(Overlay(runs, Detail::screen).budget()))},
                 {"scripts", scripts},
                 {"facts", facts_table(runs) + differences(runs)},
                 {"results", results_table(runs)},
                 {"sections", shown},
                 {"scenarios", scenarios},
                 {"version", Html(diagnostics::version)},
                 {"log", Html(runs.front().log.string())}})
      .markup();
}

}  // namespace tachless::report
