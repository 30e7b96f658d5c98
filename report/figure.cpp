#include "report/figure.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "diagnostics/text.h"
#include "report/axis_cut.h"
#include "report/gnuplot.h"

namespace tachless::report {
namespace {

constexpr int row_px = 200;

/// Each unit once: "rad, m".
std::string units_of(const std::vector<std::string>& per_joint) {
  std::vector<std::string> different;
  for (const std::string& unit : per_joint) {
    if (std::find(different.begin(), different.end(), unit) == different.end()) {
      different.push_back(unit);
    }
  }
  return diagnostics::joined(different);
}

/// One curve per joint.
Chart overlaid(const study::Tracking& tracking, study::Envelope study::JointTracking::*signal,
               const std::string& symbol) {
  Chart chart;
  chart.wide = true;
  for (std::size_t joint = 0; joint < tracking.joints().size(); ++joint) {
    chart.curves.push_back({indexed(symbol, joint), (tracking.joints()[joint].*signal).points(),
                            colour_of(joint), 1.3, dash_of(joint), CurveStyle::line});
  }
  return chart;
}

}  // namespace

std::string indexed(std::string_view symbol, std::size_t joint, std::string_view name) {
  std::string text = fmt::format("{{/:Italic {}}}_{{{}}}", symbol, joint + 1);
  if (name.empty()) return text;
  constexpr std::size_t longest = 18;
  const bool cut = name.size() > longest;  // its end is what tells joints apart
  if (cut) name.remove_prefix(name.size() - longest + 1);
  while (cut && diagnostics::utf8_length(name) == 0) name.remove_prefix(1);
  return text + fmt::format(" {{/=11 {}{}}}", cut ? "…" : "", enhanced(name));
}

Chart position_chart(const study::Tracking& tracking, std::size_t joint, const std::string& name,
                     const std::string& unit, std::size_t max_points) {
  const study::JointTracking& signals = tracking.joints()[joint];
  const bool motors = tracking.has_motors();
  Chart chart;
  chart.y_label = fmt::format("{}{}  [{}]", motors ? indexed("q", joint) + ", " : "",
                              indexed(motors ? "θ" : "q", joint, name), unit);
  chart.curves.push_back(
      {"link", signals.q.points(max_points), palette[5], 4, "", CurveStyle::line, 0, "q"});
  if (motors) {
    chart.curves.push_back({"motor", signals.theta.points(max_points), palette[1], 1.2, "",
                            CurveStyle::line, 0, "theta"});
  }
  chart.curves.push_back({"reference", signals.q_ref.points(max_points), palette[6], 1.3, "(5,4)",
                          CurveStyle::line, 0, "q_ref"});
  return chart;
}

void cut_kick(Chart& chart, const std::string& unit) {
  if (chart.curves.empty()) return;
  Range whole = range_of(chart.curves.front().points);
  Range usual = usual_range(chart.curves.front().points);
  for (const Curve& curve : chart.curves) {
    whole = join(whole, range_of(curve.points));
    usual = join(usual, usual_range(curve.points));
  }
  if (const auto cut = cut_at_kick(whole, usual)) {
    chart.y_range = {{cut->low, cut->high}};
    chart.note = cut_note(whole, unit);
  }
}

void make_logarithmic(Chart& chart) {
  chart.logarithmic_y = true;
  if (const auto floor = logarithmic_floor(chart.curves)) chart.y_range = {{*floor, INFINITY}};
}

std::string tracking_figure(const study::Tracking& tracking, const FigureFacts& facts,
                            const std::filesystem::path& svg) {
  std::vector<Chart> charts;
  for (std::size_t joint = 0; joint < tracking.joints().size(); ++joint) {
    charts.push_back(position_chart(tracking, joint, facts.joints.name[joint],
                                    facts.joints.length[joint], study::Envelope::max_points));
  }
  Chart error = overlaid(tracking, &study::JointTracking::abs_error, "e");
  error.y_label =
      fmt::format("|{{/:Italic q}} − {{/:Italic q}}_{{ref}}|  [{}]", units_of(facts.joints.length));
  make_logarithmic(error);
  // A joint without any error has nothing on this axis, nor a place in its key.
  std::erase_if(error.curves, [](const Curve& curve) {
    return std::none_of(curve.points.begin(), curve.points.end(),
                        [](const study::Point& point) { return point.y > 0; });
  });
  Chart torque = overlaid(tracking, &study::JointTracking::tau, "τ");
  torque.y_label = fmt::format("{{/:Italic τ}}  [{}]", units_of(facts.joints.effort));
  cut_kick(torque, units_of(facts.joints.effort));
  charts.insert(charts.end(), {std::move(error), std::move(torque)});
  for (Chart& chart : charts) {
    chart.height_px = row_px;
    chart.x_range = {{0, static_cast<double>(tracking.num_ticks()) * facts.period_s}};
  }
  return stacked_chart_commands(charts, facts.title, svg);
}

}  // namespace tachless::report
