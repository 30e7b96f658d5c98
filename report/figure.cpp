#include "report/figure.h"

#include <fmt/format.h>

#include <algorithm>

#include "diagnostics/text.h"
#include "report/gnuplot.h"

namespace tachless::report {
namespace {

/// Each unit once: "rad, m".
std::string units_of(const std::vector<std::string>& per_joint) {
  std::vector<std::string> different;
  for (const std::string& unit : per_joint) {
    if (std::ranges::find(different, unit) == different.end()) different.push_back(unit);
  }
  return diagnostics::joined(different);
}

/// One curve per joint.
Chart overlaid(const study::Tracking& tracking, study::Envelope study::JointTracking::*signal,
               const std::string& symbol, const std::string& y_label) {
  Chart chart;
  chart.wide = true;
  chart.y_label = y_label;
  for (std::size_t joint = 0; joint < tracking.joints().size(); ++joint) {
    chart.curves.push_back({indexed(symbol, joint), (tracking.joints()[joint].*signal).points(),
                            colour_of(joint), 1.3, dash_of(joint)});
  }
  return chart;
}

}  // namespace

Chart position_chart(const study::Tracking& tracking, std::size_t joint, const std::string& name,
                     const std::string& unit, std::size_t max_points) {
  const study::JointTracking& signals = tracking.joints()[joint];
  const bool motors = tracking.has_motors();
  Chart chart;
  chart.y_label = fmt::format("{}{}  [{}]", motors ? indexed("q", joint) + ", " : "",
                              indexed(motors ? "θ" : "q", joint, name), unit);
  chart.curves.push_back({"link", signals.q.points(max_points), palette[5], 4, "", 0, "q"});
  if (motors) {
    chart.curves.push_back(
        {"motor", signals.theta.points(max_points), palette[1], 1.2, "", 0, "theta"});
  }
  chart.curves.push_back(
      {"reference", signals.q_ref.points(max_points), palette[6], 1.3, "(5,4)", 0, "q_ref"});
  return chart;
}

std::string tracking_figure(const study::Tracking& tracking, const std::string& title,
                            double period_s, const robot::JointLabels& joints) {
  std::vector<Chart> charts;
  for (std::size_t joint = 0; joint < tracking.joints().size(); ++joint) {
    charts.push_back(position_chart(tracking, joint, joints.name[joint], joints.length[joint],
                                    study::Envelope::max_points));
  }
  Chart error = overlaid(
      tracking, &study::JointTracking::abs_error, "e",
      fmt::format("|{{/:Italic q}} − {{/:Italic q}}_{{ref}}|  [{}]", units_of(joints.length)));
  make_logarithmic(error);
  // A joint without any error has nothing on this axis, nor a place in its key.
  std::erase_if(error.curves, [](const Curve& curve) {
    return std::ranges::none_of(curve.points, [](const auto& point) { return point.y > 0; });
  });
  const std::string effort = units_of(joints.effort);
  Chart torque = overlaid(tracking, &study::JointTracking::tau, "τ",
                          fmt::format("{{/:Italic τ}}  [{}]", effort));
  cut_kick(torque, effort);
  charts.insert(charts.end(), {std::move(error), std::move(torque)});
  for (Chart& chart : charts) {
    chart.height_px = 200;
    chart.x_range = {{0, static_cast<double>(tracking.num_ticks()) * period_s}};
  }
  return stacked_chart_commands(charts, title);
}

}  // namespace tachless::report
