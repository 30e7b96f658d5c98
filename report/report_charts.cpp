#include "report/report_charts.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string_view>

#include "report/figure.h"
#include "report/gnuplot.h"
#include "report/report_events.h"

namespace tachless::report {
namespace {

bool same_points(const std::vector<study::Point>& a, const std::vector<study::Point>& b) {
  return std::equal(
      a.begin(), a.end(), b.begin(), b.end(),
      [](const study::Point& p, const study::Point& q) { return p.x == q.x && p.y == q.y; });
}

/// Several runs' positions of a joint over their references; a reference that they share once.
void overlay_positions(const Overlay& all, std::size_t joint, Chart& chart) {
  std::vector<Curve> references;
  chart.y_label = fmt::format("{}  [{}]", all.symbol("q", joint), all.length_unit(joint));
  all.for_runs_with_joint(joint, [&](std::size_t i, const RecordedRun& run, std::size_t own) {
    const study::JointTracking& signals = run.tracking.joints()[own];
    chart.curves.push_back(all.curve(i, signals.q.points(all.budget()), "q", "", 1.6));
    const auto points = signals.q_ref.points(all.budget());
    if (references.empty()) {
      references.push_back(
          {"reference", points, palette[6], 1.3, "(5,4)", CurveStyle::line, i, "q_ref"});
    } else if (!same_points(points, references.front().points)) {
      references.push_back({"", points, colour_of(i), 1.3, "(5,4)", CurveStyle::line, i, "q_ref"});
    }
  });
  chart.curves.insert(chart.curves.end(), references.begin(), references.end());
}

ReportSection tracking_section(const Overlay& all) {
  ReportSection section{"tracking", "Tracking", {}, {}, "The log holds no positions."};
  const bool motors = all.alone() && all.runs()[0].tracking.has_motors();
  section.text = html(
      "<p>True link positions{} against the reference. Curves are drawn by their extremes: every "
      "peak of every tick is in them.</p>",
      motors ? " and motor positions" : "");
  for (std::size_t joint = 0; joint < all.num_joints(); ++joint) {
    Chart chart =
        all.over_time(fmt::format("tracking-{}", joint + 1),
                      fmt::format("Position of joint {} and its reference over time", joint + 1));
    if (all.alone() && all.runs()[0].tracking.num_ticks() > 0) {
      Chart alone =
          position_chart(all.runs()[0].tracking, joint, "", all.length_unit(joint), all.budget());
      chart.y_label = alone.y_label;
      chart.curves = std::move(alone.curves);
    } else {
      overlay_positions(all, joint, chart);
    }
    section.add(all.joint_heading(joint), chart);
  }
  return section;
}

Curve fitted(const Overlay& all, const Decay& decay, std::size_t run) {
  const double end = decay.amplitude * std::exp(-decay.rate_per_s * (decay.to_s - decay.from_s));
  return {all.runs().size() <= 3 ? fmt::format("fit: {:.3g} 1/s", decay.rate_per_s) : "",
          {{decay.from_s, decay.amplitude}, {decay.to_s, end}},
          all.alone() ? palette[1] : colour_of(run),
          2.4,
          "(6,4)",
          CurveStyle::line,
          run,
          "fit"};
}

ReportSection error_section(const Overlay& all) {
  ReportSection section{
      "error", "Position error", {}, {}, "The error is zero at every tick of the log."};
  section.text = html(
      "<p>|<i>q</i> − <i>q</i><sub>ref</sub>| on a logarithmic axis. Where its upper envelope "
      "falls along an exponential by at least a factor of two, that is drawn and its rate given "
      "(slope by the median of slopes, between the peak and the instant from which on a constant "
      "fits better).{}</p>",
      all.alone() ? "" : " Broad dashes: these exponentials.");
  for (std::size_t joint = 0; joint < all.num_joints(); ++joint) {
    Chart chart = all.over_time(
        fmt::format("error-{}", joint + 1),
        fmt::format("Absolute position error of joint {} over time, logarithmic", joint + 1));
    chart.y_label = fmt::format("|{}|  [{}]", all.symbol("e", joint), all.length_unit(joint));
    std::vector<Curve> fits;
    all.for_runs_with_joint(joint, [&](std::size_t i, const RecordedRun& run, std::size_t own) {
      chart.curves.push_back(all.curve(i, run.tracking.joints()[own].abs_error.points(all.budget()),
                                       "|e|", all.alone() ? "|{/:Italic e}|" : ""));
      if (const auto& decay = run.decay[own]) fits.push_back(fitted(all, *decay, i));
    });
    make_logarithmic(chart);
    chart.curves.insert(chart.curves.end(), fits.begin(), fits.end());
    section.add(all.joint_heading(joint), chart);
  }
  return section;
}

/// @return whether the limit is drawn: one far outside would flatten the curve
bool add_limit(const RecordedRun& run, std::size_t joint, double peak, Chart& chart) {
  const auto& limit = run.scenario.plant.drive.torque_limit_Nm;
  if (!limit) return false;
  const double value = (*limit)[static_cast<Eigen::Index>(joint)];
  if (!std::isfinite(value) || value >= 3 * peak) return false;
  chart.levels.insert(chart.levels.end(), {value, -value});
  return true;
}

ReportSection torque_section(const Overlay& all) {
  ReportSection section{"torque", "Torque", {}, {}, "The log holds no torques."};
  bool limited = false;
  bool saturated = false;
  bool disturbed = false;
  for (std::size_t joint = 0; joint < all.num_joints(); ++joint) {
    Chart chart = all.over_time(fmt::format("torque-{}", joint + 1),
                                fmt::format("Torque applied to joint {} over time", joint + 1));
    chart.y_label = fmt::format("{}  [{}]", all.symbol("τ", joint), all.effort_unit(joint));
    all.for_runs_with_joint(joint, [&](std::size_t i, const RecordedRun& run, std::size_t own) {
      const study::JointTracking& signals = run.tracking.joints()[own];
      chart.curves.push_back(all.curve(i, signals.tau.points(all.budget()), "τ"));
      if (!run.disturbance.empty()) {
        chart.curves.push_back(
            all.curve(i, run.disturbance[own].points(all.budget()), "", "disturbance", 1.0));
        chart.curves.back().dash = "(5,4)";
        if (all.alone()) chart.curves.back().colour = palette[1];
        disturbed = true;
      }
      limited = add_limit(run, own, signals.torque.peak(), chart) || limited;
      const double h = run.info.period_s;
      for (const auto& [first, last] : run.saturated[own].listed()) {
        chart.marks.push_back({static_cast<double>(first) * h, static_cast<double>(last + 1) * h,
                               all.alone() ? alarm_colour : colour_of(i)});
        saturated = true;
      }
    });
    cut_kick(chart, all.effort_unit(joint));
    section.add(all.joint_heading(joint), chart);
  }
  section.text = html("<p>Torque that acted over each tick, after delay and limit.{}{}{}</p>",
                      disturbed ? " Dashed: the torque of plant.disturbances." : "",
                      limited ? " Dotted: the drive's limit." : "",
                      saturated ? " Bars at the top: the command exceeded the limit." : "");
  return section;
}

/// What a law's declared signal is, by its name, which the laws' pages explain.
std::string_view meaning(std::string_view name) {
  if (name.starts_with("nu")) {
    return "the filter's output: the filtered derivative of the position error, which the law uses "
           "in place of the velocity error";
  }
  if (name.starts_with("edot")) return "the velocity error, of measured velocities";
  return "as the law computed it";
}

ReportSection signals_section(const Overlay& all) {
  ReportSection section{"controller",
                        "Controller signals",
                        {},
                        {},
                        "The log holds no signals of the law: it declares none besides the "
                        "position error, or they were not recorded."};
  const auto& runs = all.runs();
  std::map<std::string, std::string> units;
  for (const RecordedRun& run : runs) {
    for (const LoggedSignal& signal : run.signals) units.emplace(signal.name, signal.unit);
  }
  for (const auto& [name, unit] : units) {
    section.text += html("<p><i>{}</i> [{}]: {}.</p>", name, unit, meaning(name));
  }
  for (std::size_t joint = 0; joint < all.num_joints(); ++joint) {
    Chart chart = all.over_time(fmt::format("controller-{}", joint + 1),
                                fmt::format("Controller signals of joint {} over time", joint + 1));
    std::string unit;
    for (std::size_t i = 0; i < runs.size(); ++i) {
      const auto own = all.joint_of(i, joint);
      for (std::size_t row = 0; own && row < runs[i].signals.size(); ++row) {
        const LoggedSignal& signal = runs[i].signals[row];
        Curve curve = all.curve(i, signal.joints[*own].points(all.budget()), signal.name, "",
                                row == 0 ? 1.2 : 0.7);
        if (all.alone()) {
          curve.colour = colour_of(row);
          curve.title = signal.name;  // nu_2: the 2 becomes an index
        }
        unit = signal.unit == "rad/s" ? all.length_unit(joint) + "/s" : signal.unit;
        chart.curves.push_back(std::move(curve));
      }
    }
    chart.y_label = fmt::format("[{}]", unit);
    cut_kick(chart, unit);
    section.add(all.joint_heading(joint), chart);
  }
  return section;
}

/// What is certified of V, and whether the run kept to it.
Html certified_text(const RecordedRun& run) {
  const certificate::CertifiedRun& certified = *run.certified;
  const auto number = [](double x) { return fmt::format("{:.3g}", x); };
  Html text = html(" With ε<sub>1</sub> = {} 1/s, ε<sub>2</sub> = {}",
                   number(certified.weights.eps_1), number(certified.weights.eps_2));
  if (certified.rate < 0) {
    text += html(
        " the matrix condition certifies V ≤ {} J, which does not hold this run's start with {} J: "
        "no bound.",
        number(certified.level), number(certified.V0));
    return text;
  }
  text +=
      certified.rate == 0
          ? html(" V does not rise (in continuous time, proved for a constant reference).")
          : html(
                " the matrix condition certifies from this start V ≤ V(0) exp(−{} t) in continuous "
                "time ({}; dotted), and that V stays below {} J from anywhere below.",
                number(certified.rate), certified.proved ? "proved" : "sampled postures",
                number(certified.level));
  for (const std::string& each : certified.provisos) text += html(" But {}.", each);
  if (run.above_bound_s) {
    text += html(
        " <b class=\"alarm\">The bound is violated from {} s on</b>: the loop is not the one that "
        "is certified; see its period, delay, torque limits and model.",
        number(*run.above_bound_s));
  }
  return text;
}

Html lyapunov_text(const RecordedRun& run) {
  if (run.lyapunov_formula.empty()) {
    return html("for {} no function is evaluated.", run.scenario.controller.law_text());
  }
  Html text = html("<i>V</i> = {}, at the plant's true state and the law's own model.",
                   run.lyapunov_formula);
  if (run.certified) {
    text += certified_text(run);
  } else if (run.scenario.num_joints > certificate::most_joints_of_certified_run) {
    text += html(" With more than {} joints no report searches a bound: `tachless certify` does.",
                 certificate::most_joints_of_certified_run);
  }
  return text;
}

/// The certified bound from the start to the run's end, down to where V ends.
Curve bound_of(std::size_t i, const RecordedRun& run, const std::vector<study::Point>& V) {
  Curve bound{"",
              {},
              run.above_bound_s ? alarm_colour : palette[6],
              1.4,
              "(2,3)",
              CurveStyle::line,
              i,
              "certified bound"};
  double least = V.front().y;
  for (const study::Point& each : V) least = each.y > 0 ? std::min(least, each.y) : least;
  constexpr int pieces = 200;
  for (int k = 0; k <= pieces; ++k) {
    const double t_s = V.back().x * k / pieces;
    if (const double y = run.certified->bound(t_s); y >= least) bound.points.push_back({t_s, y});
  }
  return bound;
}

ReportSection lyapunov_section(const Overlay& all) {
  ReportSection section{"lyapunov", "Lyapunov function", {}, {}, ""};
  Chart chart = all.over_time("lyapunov-v", "Lyapunov function along the run, logarithmic");
  chart.y_label = "{/:Italic V}  [J]";
  chart.wide = true;
  std::vector<Curve> fits;
  const auto& runs = all.runs();
  for (std::size_t i = 0; i < runs.size(); ++i) {
    if (runs[i].lyapunov_formula.empty()) continue;
    const std::vector<study::Point> V = runs[i].lyapunov.points(all.budget());
    chart.curves.push_back(all.curve(i, V, "V", "", 1.4));
    if (runs[i].certified && runs[i].certified->rate >= 0 && V.size() > 1) {
      fits.push_back(bound_of(i, runs[i], V));
      if (all.alone()) fits.back().title = "certified bound";
      // One far above would flatten the curve.
      const double level = runs[i].certified->level;
      if (level < 100 * runs[i].certified->V0) chart.levels.push_back(level);
    }
    if (runs[i].lyapunov_decay) fits.push_back(fitted(all, *runs[i].lyapunov_decay, i));
  }
  const bool alike = std::all_of(runs.begin(), runs.end(), [&](const RecordedRun& run) {
    return lyapunov_text(run).markup() == lyapunov_text(runs.front()).markup();
  });
  for (const RecordedRun& run : runs) {
    if (alike && &run != &runs.front()) break;
    section.text += html("<p>{}{}</p>", alike ? "" : run.label + ": ", lyapunov_text(run));
  }
  section.text += html(
      "<p>A torque that is held over a tick, an encoder's counts and a payload keep V above "
      "zero.</p>");
  section.without =
      "There is no V to draw: it takes the true state (TRUTH), the reference and the controller's "
      "state, of a law whose function is known.";
  make_logarithmic(chart);
  chart.curves.insert(chart.curves.end(), fits.begin(), fits.end());
  section.add("", chart);
  return section;
}

}  // namespace

std::vector<ReportSection> report_sections(const std::vector<RecordedRun>& runs, Detail detail) {
  const Overlay all(runs, detail);
  return {tracking_section(all), error_section(all),  torque_section(all), signals_section(all),
          lyapunov_section(all), timing_section(all), events_section(all)};
}

}  // namespace tachless::report
