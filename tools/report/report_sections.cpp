#include "report/report_sections.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string_view>
#include <utility>

#include "base/text.h"

namespace tachless::report {
namespace {

/// Returns each unit once: "rad, m".
std::string units_of(const std::vector<std::string>& per_joint) {
  std::vector<std::string> different;
  for (const std::string& unit : per_joint) {
    if (std::ranges::find(different, unit) == different.end()) different.push_back(unit);
  }
  return base::joined(different);
}

/// Returns a chart with one curve per joint.
Chart overlaid(const study::Tracking& tracking, study::Envelope study::JointTracking::*signal,
               const std::string& symbol, Label y_label, std::size_t max_points) {
  Chart chart;
  chart.wide = true;
  chart.y_label = std::move(y_label);
  for (std::size_t joint = 0; joint < tracking.joints().size(); ++joint) {
    chart.curves.push_back({of_joint(symbol, joint),
                            (tracking.joints()[joint].*signal).points(max_points), colour_of(joint),
                            1.3, dash_of(joint)});
  }
  return chart;
}

/// Adds link angle, motor angle if there is one, and reference of one joint, with labels.
void add_positions(Chart& chart, const study::Tracking& tracking, std::size_t joint,
                   const std::string& name, const std::string& unit, std::size_t max_points) {
  const study::JointTracking& signals = tracking.joints()[joint];
  const bool motors = tracking.has_motors();
  chart.y_label = of_joint(motors ? "q, θ" : "q", joint, name, unit);
  chart.curves.push_back({words("link"), signals.q.points(max_points), palette[5], 4, {}, 0, "q"});
  if (motors) {
    chart.curves.push_back(
        {words("motor"), signals.theta.points(max_points), palette[1], 1.2, {}, 0, "theta"});
  }
  chart.curves.push_back(
      {words("reference"), signals.q_ref.points(max_points), palette[6], 1.3, {5, 4}, 0, "q_ref"});
}

/// A joint of a report, with the properties on which its runs agree.
struct Joint {
  const Overlay& all;
  std::size_t number;
  std::string length, effort;  ///< units of the first run that has the joint

  Joint(const Overlay& overlay, std::size_t i) : all(overlay), number(i) {
    for (const RecordedRun& run : all.runs) {
      const auto own = all.joint_of(run, number);
      if (own && length.empty()) length = run.joints.length[*own];
    }
    effort = length == "m" ? "N" : "N m";
  }
  /// Returns a label with the joint's number if all runs number the joint alike.
  [[nodiscard]] Label label(const std::string& symbol, const std::string& unit) const {
    return all.numbered_alike ? of_joint(symbol, number, "", unit) : Label{symbol, "", "", unit};
  }
  [[nodiscard]] std::string heading() const {
    const std::string& name = all.joints[number];
    return all.numbered_alike ? fmt::format("Joint {} · {}", number + 1, name) : name;
  }
  /// Calls `visit(run, the run's own number of the joint)` for each run that tracks the joint.
  template <class Visit>
  void for_runs(const Visit& visit) const {
    for (const RecordedRun& run : all.runs) {
      const auto own = all.joint_of(run, number);
      if (own && run.tracking.num_ticks() > 0) visit(run, *own);
    }
  }
};

/// Adds a chart for each joint and calls `fill` for its content.
/// @param caption with {} for the joint's number
template <class Fill>
void add_joints(ReportSection& section, const Overlay& all, fmt::format_string<std::size_t> caption,
                const Fill& fill) {
  for (std::size_t i = 0; i < all.joints.size(); ++i) {
    const Joint joint(all, i);
    Chart chart =
        all.over_time(fmt::format("{}-{}", section.name, i + 1), fmt::format(caption, i + 1));
    chart.heading = joint.heading();
    fill(joint, chart);
    section.add(std::move(chart));
  }
}

/// Adds several runs' positions of a joint over their references. A common reference appears once.
void overlay_positions(const Overlay& all, const Joint& joint, Chart& chart) {
  std::vector<Curve> references;
  chart.y_label = joint.label("q", joint.length);
  joint.for_runs([&](const RecordedRun& run, std::size_t own) {
    const study::JointTracking& signals = run.tracking.joints()[own];
    chart.curves.push_back(all.curve(run, signals.q.points(all.budget), "q", {}, 1.6));
    const auto points = signals.q_ref.points(all.budget);
    const bool first = references.empty();
    if (!first && points == references.front().points) return;
    references.push_back({words(first ? "reference" : ""),
                          points,
                          first ? palette[6] : colour_of(run.number),
                          1.3,
                          {5, 4},
                          run.number,
                          "q_ref"});
  });
  chart.curves.insert(chart.curves.end(), references.begin(), references.end());
}

ReportSection tracking_section(const Overlay& all) {
  ReportSection section{"tracking", "Tracking", "The log holds no positions."};
  const study::Tracking& first = all.runs[0].tracking;
  section.text = html(
      "<p>True link positions{} against the reference. Curves are drawn by their extremes: every "
      "peak of every tick is in them.</p>",
      all.alone() && first.has_motors() ? " and motor positions" : "");
  add_joints(section, all, "Position of joint {} and its reference over time",
             [&](const Joint& joint, Chart& chart) {
               if (!all.alone() || first.num_ticks() == 0) {
                 return overlay_positions(all, joint, chart);
               }
               add_positions(chart, first, joint.number, "", joint.length, all.budget);
             });
  return section;
}

ReportSection error_section(const Overlay& all) {
  ReportSection section{"error", "Position error", "The error is zero at every tick of the log."};
  section.text = html(
      "<p>|<i>q</i> − <i>q</i><sub>ref</sub>| on a logarithmic axis. Where its upper envelope "
      "falls along an exponential by at least a factor of two, that is drawn and its rate given "
      "(slope by the median of slopes, between the peak and the instant from which on a constant "
      "fits better).{}</p>",
      all.alone() ? "" : " Broad dashes: these exponentials.");
  add_joints(section, all, "Absolute position error of joint {} over time, logarithmic",
             [&](const Joint& joint, Chart& chart) {
               chart.y_label = joint.label("e", joint.length);
               chart.y_label.magnitude = true;
               std::vector<Curve> fits;
               joint.for_runs([&](const RecordedRun& run, std::size_t own) {
                 chart.curves.push_back(
                     all.curve(run, run.tracking.joints()[own].abs_error.points(all.budget), "|e|",
                               words(all.alone() ? "error" : "")));
                 if (const auto& decay = run.decay[own]) fits.push_back(fitted(all, *decay, run));
               });
               make_logarithmic(chart);
               chart.curves.insert(chart.curves.end(), fits.begin(), fits.end());
             });
  return section;
}

/// Draws the torque limit unless it is so far outside `peak` that it would flatten the curve.
/// @return whether the limit is drawn
bool add_limit(const RecordedRun& run, std::size_t joint, double peak, Chart& chart) {
  const auto& limit = run.scenario.plant.drive.torque_limit_Nm;
  if (!limit) return false;
  const double value = (*limit)[static_cast<Eigen::Index>(joint)];
  if (!std::isfinite(value) || value >= 3 * peak) return false;
  chart.levels.insert(chart.levels.end(), {value, -value});
  return true;
}

/// Draws the torques that the arm told of a joint. Returns true if there are some.
bool add_told(const Overlay& all, const RecordedRun& run, std::size_t own, Chart& chart) {
  std::size_t colour = 2;
  for (const auto& [name, torque] :
       {std::pair{"accepted", &run.accepted_torque}, std::pair{"measured", &run.measured_torque}}) {
    if (torque->empty()) continue;
    chart.curves.push_back(
        all.curve(run, (*torque)[own].points(all.budget), name, words(name), 1.0));
    chart.curves.back().dash = {2, 3};
    if (all.alone()) chart.curves.back().colour = palette[colour];
    ++colour;
  }
  return colour > 2;
}

ReportSection torque_section(const Overlay& all) {
  ReportSection section{"torque", "Torque", "The log holds no torques."};
  bool limited = false;
  bool saturated = false;
  bool disturbed = false;
  bool told = false;
  add_joints(
      section, all, "Torque applied to joint {} over time", [&](const Joint& joint, Chart& chart) {
        chart.y_label = joint.label("τ", joint.effort);
        joint.for_runs([&](const RecordedRun& run, std::size_t own) {
          const study::JointTracking& signals = run.tracking.joints()[own];
          chart.curves.push_back(all.curve(run, signals.tau.points(all.budget), "τ"));
          if (!run.disturbance.empty()) {
            chart.curves.push_back(all.curve(run, run.disturbance[own].points(all.budget),
                                             "disturbance", words("disturbance"), 1.0));
            chart.curves.back().dash = {5, 4};
            if (all.alone()) chart.curves.back().colour = palette[1];
            disturbed = true;
          }
          told = add_told(all, run, own, chart) || told;
          limited =
              add_limit(run, own, all.live ? HUGE_VAL : signals.torque.peak(), chart) || limited;
          for (const auto& [from, to] : run.seconds(run.saturated[own].listed)) {
            chart.marks.push_back({from, to, all.alone() ? alarm_colour : colour_of(run.number)});
            saturated = true;
          }
        });
        cut_kick(chart, joint.effort);
      });
  section.text = html("<p>Torque that acted over each tick, after delay and limit.{}{}{}{}</p>",
                      disturbed ? " Dashed: the torque of plant.disturbances, or of contacts." : "",
                      told ? " Fine dots: torques that the arm told with its readings." : "",
                      limited ? " Dotted: the drive's limit." : "",
                      saturated ? " Bars at the top: the command exceeded the limit." : "");
  return section;
}

/// Draws the force of the runs that know contacts. Without one the section has no chart.
ReportSection contact_section(const Overlay& all) {
  ReportSection section{"contact", "Contact", ""};
  Chart chart = all.over_time("contact-1", "Force of the contact that presses most, over time");
  chart.y_label = {"F", "", "", "N"};
  chart.wide = true;
  for (const RecordedRun& run : all.runs) {
    const auto points = run.contact_force.points(all.budget);
    if (points.empty()) continue;
    chart.curves.push_back(all.curve(run, points, "contact", {}, 1.4));
    section.text +=
        html("<p>{}{}.</p>", all.alone() ? "" : run.label + ": ", run.contacts.heading());
  }
  section.text += html(
      "<p>Force between the two geoms that press most, one of which is the robot's, at the start "
      "of each tick, by the simulator. No certificate is about a robot in contact.</p>");
  section.add(std::move(chart));
  return section;
}

ReportSection model_section(const Overlay& all) {
  ReportSection section{"model", "Torque of the model",
                        "It is shown for rigid joints, of runs of at least 2 s without a gap at "
                        "the start."};
  std::string errors;
  add_joints(section, all, "Torque applied to joint {}, and that of the model for the motion",
             [&](const Joint& joint, Chart& chart) {
               chart.y_label = joint.label("τ", joint.effort);
               joint.for_runs([&](const RecordedRun& run, std::size_t own) {
                 if (run.model_torque.empty()) return;
                 const ModelTorque& torque = run.model_torque[own];
                 chart.curves.push_back(all.curve(run, torque.applied.points(all.budget), "τ",
                                                  words(all.alone() ? "applied" : "")));
                 chart.curves.push_back(
                     all.curve(run, torque.model.points(all.budget), "", words("model"), 1.0));
                 chart.curves.back().dash = {5, 4};
                 if (all.alone()) chart.curves.back().colour = palette[1];
                 errors += fmt::format("{}{}{} {:.2g} %", errors.empty() ? "" : ", ",
                                       all.alone() ? "" : run.label + " ", run.joints.name[own],
                                       100 * torque.error);
               });
             });
  section.text = html(
      "<p>Below 15 Hz: torque that was applied, and (dashed) what the scenario's robot with its "
      "rotors, friction and payload takes for the measured motion, by inverse dynamics of the "
      "filtered positions.{} What a robot has and its scenario has not is in between: see "
      "tachless identify.</p>",
      errors.empty() ? "" : " Rms of the difference over the peak: " + errors + ".");
  return section;
}

/// Returns the meaning of a law's declared signal by its name, as the laws' pages explain it.
std::string_view meaning(std::string_view name) {
  if (name.starts_with("nu")) {
    return "the filter's output: the filtered derivative of the position error, which the law uses "
           "in place of the velocity error";
  }
  if (name.starts_with("edot")) return "the velocity error, of measured velocities";
  return "as the law computed it";
}

/// Returns a signal's label. The part after an underscore is an index: nu_2.
Label signal_label(const std::string& name) {
  const std::size_t bar = name.find('_');
  if (bar == std::string::npos) return {name, "", "", ""};
  return {name.substr(0, bar), name.substr(bar + 1), "", ""};
}

/// Adds the signals of that unit. An estimate that is the same for all joints appears at the first.
void add_signals(const Overlay& all, const Joint& joint, const std::string& unit, Chart& chart) {
  for (const RecordedRun& run : all.runs) {
    const auto own = all.joint_of(run, joint.number);
    for (std::size_t row = 0; own && row < run.signals.size(); ++row) {
      const LoggedSignal& signal = run.signals[row];
      if (signal.unit != unit || signal.repeats_first(*own)) continue;
      Curve curve = all.curve(run, signal.joints[*own].points(all.budget), signal.name, {},
                              row == 0 ? 1.2 : 0.7);
      if (all.alone()) {
        curve.colour = colour_of(row);
        curve.label = signal_label(signal.name);
      }
      chart.curves.push_back(std::move(curve));
    }
  }
  const std::string of_joint = unit == "rad/s" ? joint.length + "/s" : unit;
  chart.y_label = words("", of_joint);
  cut_kick(chart, of_joint);
}

ReportSection signals_section(const Overlay& all) {
  ReportSection section{"controller", "Controller signals",
                        "The log holds no signals of the law: it declares none but the "
                        "position error, or they were not recorded."};
  std::map<std::string, std::string> units;
  std::vector<std::string> axes;  // a chart for each unit
  for (const RecordedRun& run : all.runs) {
    for (const LoggedSignal& signal : run.signals) {
      units.emplace(signal.name, signal.unit);
      if (std::ranges::find(axes, signal.unit) == axes.end()) axes.push_back(signal.unit);
    }
  }
  for (const auto& [name, unit] : units) {
    section.text += html("<p><i>{}</i> [{}]: {}.</p>", name, unit, meaning(name));
  }
  for (std::size_t axis = 0; axis < axes.size(); ++axis) {
    add_joints(section, all, "Controller signals of joint {} over time",
               [&](const Joint& joint, Chart& chart) {
                 if (axis > 0) chart.name += fmt::format("-{}", axis + 1);
                 add_signals(all, joint, axes[axis], chart);
               });
  }
  return section;
}

}  // namespace

void ReportSection::add(Chart chart) {
  if (has_something(chart)) charts.push_back(std::move(chart));
}

Overlay::Overlay(const std::vector<RecordedRun>& labelled) : runs(labelled) {
  std::size_t curves = 0;
  for (const RecordedRun& run : runs) {
    const std::vector<std::string>& names = run.joints.name;
    curves += names.size();
    numbered_alike = numbered_alike && names == runs.front().joints.name;
    for (const std::string& name : names) {
      if (std::ranges::find(joints, name) == joints.end()) joints.push_back(name);
    }
    end_s = std::max(end_s, run.end_s());
  }
  if (!(end_s > 0)) end_s = 1;
  // About 2 MB of points for five curves per joint, for any number of runs and joints.
  constexpr std::size_t most = 40'000;
  budget = std::min(most / std::max<std::size_t>(1, curves), study::Envelope::max_points);
}

std::optional<std::size_t> Overlay::joint_of(const RecordedRun& run, std::size_t joint) const {
  const std::vector<std::string>& names = run.joints.name;
  const auto found = std::ranges::find(names, joints[joint]);
  if (found == names.end()) return std::nullopt;
  return static_cast<std::size_t>(found - names.begin());
}

Chart Overlay::over_time(const std::string& name, const std::string& caption) const {
  Chart chart;
  chart.name = name;
  chart.caption = caption;
  chart.x_range = {{0, end_s}};
  return chart;
}

Curve Overlay::curve(const RecordedRun& run, const std::vector<study::Point>& points,
                     const std::string& signal, Label label, double width) const {
  return {std::move(label),
          points,
          colour_of(run.number),
          width,
          alone() ? std::vector<int>() : dash_of(run.number),
          run.number,
          signal};
}

Curve fitted(const Overlay& all, const Decay& decay, const RecordedRun& run) {
  const double end = decay.amplitude * std::exp(-decay.rate_per_s * (decay.to_s - decay.from_s));
  return {words(all.runs.size() <= 3 ? fmt::format("fit: {:.3g} 1/s", decay.rate_per_s) : ""),
          {{decay.from_s, decay.amplitude}, {decay.to_s, end}},
          all.alone() ? palette[1] : colour_of(run.number),
          2.4,
          {6, 4},
          run.number,
          "fit"};
}

Figure tracking_figure(const study::Tracking& tracking, const std::string& title, double end_s,
                       const robot::JointLabels& joints, std::size_t max_points) {
  Figure figure{title, {}, tracking.joints().size() > 3 ? 2U : 1U};
  std::vector<Chart>& charts = figure.charts;
  for (std::size_t joint = 0; joint < tracking.joints().size(); ++joint) {
    add_positions(charts.emplace_back(), tracking, joint, joints.name[joint], joints.length[joint],
                  max_points);
  }
  Label error_label{"e", "", "", units_of(joints.length), true};
  Chart error = overlaid(tracking, &study::JointTracking::abs_error, "e", error_label, max_points);
  make_logarithmic(error);
  // A joint without any error has neither a curve on this axis nor an entry in its key.
  std::erase_if(error.curves, [&](const Curve& curve) {
    return std::ranges::none_of(curve.points,
                                [&](const auto& point) { return shown(error, point); });
  });
  const std::string effort = units_of(joints.effort);
  Chart torque =
      overlaid(tracking, &study::JointTracking::tau, "τ", {"τ", "", "", effort}, max_points);
  cut_kick(torque, effort);
  charts.insert(charts.end(), {std::move(error), std::move(torque)});
  for (Chart& chart : charts) {
    chart.height_px = 150;
    chart.x_range = {{0, end_s}};
  }
  return figure;
}

std::vector<ReportSection> report_sections(const Overlay& all) {
  std::vector<ReportSection> sections = {
      tracking_section(all), error_section(all),    torque_section(all), model_section(all),
      signals_section(all),  lyapunov_section(all), timing_section(all), events_section(all)};
  if (ReportSection contact = contact_section(all); !contact.charts.empty()) {
    sections.insert(sections.begin() + 3, std::move(contact));
  }
  return sections;
}

}  // namespace tachless::report
