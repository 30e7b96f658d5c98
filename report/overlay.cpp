#include "report/overlay.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "report/gnuplot.h"

namespace tachless::report {

void ReportSection::add(const std::string& chart_heading, Chart chart) {
  if (has_something(chart)) charts.push_back({chart_heading, std::move(chart)});
}

Overlay::Overlay(const std::vector<RecordedRun>& runs) : runs_(runs) {
  for (const RecordedRun& run : runs_) {
    num_joints_ = std::max(num_joints_, run.tracking.joints().size());
    const auto ticks = static_cast<double>(run.summary.last_tick + 1);
    end_s_ = std::max(end_s_, ticks * run.info.period_s);
  }
  if (!(end_s_ > 0)) end_s_ = 1;
}

Curve Overlay::curve(std::size_t run, const std::vector<study::Point>& points,
                     const std::string& title, double width) const {
  return {title, points, colour_of(run), width, dash(run), CurveStyle::line};
}

std::string Overlay::joint_heading(std::size_t joint) const {
  for (const RecordedRun& run : runs_) {
    if (joint >= run.joints.name.size()) continue;
    return fmt::format("Joint {} · {}", joint + 1, run.joints.name[joint]);
  }
  return fmt::format("Joint {}", joint + 1);
}

std::string Overlay::length_unit(std::size_t joint) const {
  for (const RecordedRun& run : runs_) {
    if (joint < run.joints.length.size()) return run.joints.length[joint];
  }
  return "";
}

std::string Overlay::effort_unit(std::size_t joint) const {
  for (const RecordedRun& run : runs_) {
    if (joint < run.joints.effort.size()) return run.joints.effort[joint];
  }
  return "";
}

Chart Overlay::over_time(const std::string& name, const std::string& caption) const {
  Chart chart;
  chart.name = name;
  chart.caption = caption;
  chart.x_range = {{0, end_s_}};
  return chart;
}

}  // namespace tachless::report
