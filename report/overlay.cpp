#include "report/overlay.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "report/figure.h"
#include "report/gnuplot.h"

namespace tachless::report {

void ReportSection::add(const std::string& chart_heading, Chart chart, std::size_t run) {
  if (has_something(chart)) charts.push_back({chart_heading, std::move(chart), run});
}

Overlay::Overlay(const std::vector<RecordedRun>& runs, Detail detail) : runs_(runs) {
  std::size_t curves = 0;
  for (const RecordedRun& run : runs_) {
    const std::vector<std::string>& names = run.joints.name;
    curves += names.size();
    numbered_alike_ = numbered_alike_ && names == runs_.front().joints.name;
    for (const std::string& name : names) {
      if (std::find(joints_.begin(), joints_.end(), name) == joints_.end()) joints_.push_back(name);
    }
    const auto ticks = static_cast<double>(run.summary.last_tick + 1);
    end_s_ = std::max(end_s_, ticks * run.info.period_s);
  }
  if (!(end_s_ > 0)) end_s_ = 1;
  // 2 MB of points for five curves a joint, whatever the number of runs and joints.
  constexpr std::size_t on_screen = 40'000;
  budget_ = detail == Detail::screen ? std::min(on_screen / std::max<std::size_t>(1, curves),
                                                study::Envelope::max_points)
            : alone()                ? 1600
                                     : 1000;
}

std::optional<std::size_t> Overlay::joint_of(std::size_t run, std::size_t joint) const {
  const std::vector<std::string>& names = runs_[run].joints.name;
  const auto found = std::find(names.begin(), names.end(), joints_[joint]);
  if (found == names.end()) return std::nullopt;
  return static_cast<std::size_t>(found - names.begin());
}

Curve Overlay::curve(std::size_t run, const std::vector<study::Point>& points,
                     const std::string& signal, const std::string& title, double width) const {
  return {title, points, colour_of(run), width, dash(run), CurveStyle::line, run, signal};
}

std::string Overlay::symbol(std::string_view symbol, std::size_t joint) const {
  return numbered_alike_ ? indexed(symbol, joint) : fmt::format("{{/:Italic {}}}", symbol);
}

std::string Overlay::joint_heading(std::size_t joint) const {
  return numbered_alike_ ? fmt::format("Joint {} · {}", joint + 1, joints_[joint]) : joints_[joint];
}

std::string Overlay::length_unit(std::size_t joint) const {
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    if (const auto own = joint_of(i, joint)) return runs_[i].joints.length[*own];
  }
  return "";
}

std::string Overlay::effort_unit(std::size_t joint) const {
  return length_unit(joint) == "m" ? "N" : "N m";
}

Chart Overlay::over_time(const std::string& name, const std::string& caption) const {
  Chart chart;
  chart.name = name;
  chart.caption = caption;
  chart.x_range = {{0, end_s_}};
  return chart;
}

}  // namespace tachless::report
