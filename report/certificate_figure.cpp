#include "report/certificate_figure.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "report/gnuplot.h"
#include "robot/model.h"

namespace tachless::report {
namespace {

using certificate::Certified;
using certificate::SampledCertificate;
using certificate::StabilityCertificate;
using Eigen::Index;
using Eigen::VectorXd;

/// One diagram.
struct Panel {
  std::string settings;
  Plot plot;

  Panel(const std::string& title, const std::string& x, const std::string& y)
      : settings(fmt::format("set title {}\nset xlabel {} offset 0,0.5\nset ylabel {}\n",
                             gnuplot_text(title), gnuplot_text(x), gnuplot_text(y))) {}

  void curve(const std::string& name, const std::string& with, std::size_t colour,
             const std::vector<std::pair<double, double>>& points) {
    std::string rows;
    for (const auto& [x, y] : points) {
      if (std::isfinite(x) && std::isfinite(y)) rows += fmt::format("{:.9g} {:.9g}\n", x, y);
    }
    plot.add(rows, fmt::format("using 1:2 with {} lc rgb '{}' {}", with,
                               palette[colour % palette.size()], titled(name)));
  }
};

/// Tics on a logarithmic axis.
std::string one_two_five(double low, double high) {
  std::vector<double> tics;
  for (double decade = std::pow(10, std::floor(std::log10(low))); decade <= high; decade *= 10) {
    for (const double digit : {1, 2, 5}) tics.push_back(digit * decade);
  }
  return fmt::format("{:.3g}", fmt::join(tics, ", "));
}

Panel period_panel(const SampledCertificate& s) {
  std::vector<std::pair<double, double>> margin, radius;
  for (const auto& point : s.by_period) {
    margin.emplace_back(1e3 * point.period_s, point.modulus);
    radius.emplace_back(1e3 * point.period_s, point.radius);
  }
  Panel panel("Margin against sampling period", "period [ms]", "modulus margin, spectral radius");
  constexpr double top = 1.3;
  panel.settings += fmt::format(
      "set logscale x\nset xtics ({})\nset xrange [{:.9g}:{:.9g}]\nset yrange [0:{:g}]\n",
      one_two_five(margin.front().first, margin.back().first), margin.front().first,
      margin.back().first, top);
  panel.curve("modulus margin", "linespoints pt 7 ps 0.4 lw 1.6", 0, margin);
  panel.curve("spectral radius", "lines lw 1.6", 1, radius);
  const auto vertical = [&](const std::string& name, double period_s, std::size_t colour) {
    panel.curve(name, "lines dashtype (6,4) lw 1.2", colour,
                {{1e3 * period_s, 0}, {1e3 * period_s, top}});
  };
  vertical("this scenario's period", s.settings.period_s, 6);
  if (s.limit_s) vertical("largest stable period", *s.limit_s, 2);
  return panel;
}

Panel along_panel(const SampledCertificate& s) {
  std::vector<std::pair<double, double>> points, whole;
  double smallest = 1, largest = 0;
  for (const auto& point : s.along) {
    points.emplace_back(point.t_s, 1 - point.radius);
    smallest = std::min(smallest, 1 - point.radius);
    largest = std::max(largest, 1 - point.radius);
  }
  whole = {{s.along.front().t_s, 1 - s.radius_along}, {s.along.back().t_s, 1 - s.radius_along}};
  Panel panel("Along the reference: stable above 0", "time [s]", "1 - spectral radius");
  const double room = std::max(0.1 * (largest - smallest), 1e-3 * std::abs(largest));
  panel.settings += fmt::format("set yrange [{:.9g}:{:.9g}]\n",
                                std::min({0.0, smallest - room, 1 - s.radius_along - room}),
                                std::max(largest, 1 - s.radius_along) + 3 * room);
  panel.curve("map of one period, frozen", "lines lw 1.6", 0, points);
  panel.curve("product over the motion, per period", "lines lw 1.6 dashtype (5,4)", 1, whole);
  return panel;
}

/// The boundary of V = level in the plane of the coordinates i and j of x, seen from `centre`,
/// which is inside.
std::vector<std::pair<double, double>> section(const StabilityCertificate& s,
                                               const Certified& choice,
                                               const experiment::Scenario& scenario,
                                               const VectorXd& centre, Index i, Index j) {
  const robot::Model model = certificate::error_model(scenario);
  const robot::Vector q_ref =
      scenario.plant.initial.position_rad.size() > 0
          ? robot::Vector(scenario.plant.initial.position_rad - s.initial.head(model.num_joints))
          : robot::Vector(-s.initial.head(model.num_joints));
  const auto V = [&](const VectorXd& x) {
    const robot::Vector q = q_ref + x.head(model.num_joints);
    return lyapunov_value(s.system, choice.weights, model, q, x);
  };
  const auto& region = choice.region;
  const double scale_i = region.e_at_rest[i], scale_j = region.edot[j - 2 * s.system.num_errors()];
  std::vector<std::pair<double, double>> points;
  constexpr int directions = 180;
  for (int k = 0; k <= directions; ++k) {
    const double angle = 2 * std::numbers::pi * k / directions;
    const auto at = [&](double r) {
      VectorXd x = centre;
      x[i] += r * scale_i * std::cos(angle);
      x[j] += r * scale_j * std::sin(angle);
      return x;
    };
    double inside = 0, outside = 1;
    while (V(at(outside)) < region.level && outside < 1e3) outside *= 2;
    for (int halving = 0; halving < 40; ++halving) {
      const double middle = (inside + outside) / 2;
      (V(at(middle)) < region.level ? inside : outside) = middle;
    }
    const VectorXd x = at(inside);
    points.emplace_back(x[i], x[j]);
  }
  return points;
}

Panel region_panel(const StabilityCertificate& s, const experiment::Scenario& scenario,
                   Index joint) {
  const Index edot = 2 * s.system.num_errors() + joint;
  Panel panel(
      fmt::format("Certified region, {}",
                  robot::joint_labels(*scenario.model).joint(static_cast<std::size_t>(joint))),
      fmt::format("e{} [rad; m]", joint + 1), fmt::format("edot{} [rad/s; m/s]", joint + 1));
  const auto add = [&](const std::optional<Certified>& choice, const std::string& name,
                       std::size_t colour) {
    if (!choice) return;
    const VectorXd centre =
        choice->holds_initial_state() ? s.initial : VectorXd(VectorXd::Zero(s.initial.size()));
    panel.curve(name, "lines lw 1.6", colour, section(s, *choice, scenario, centre, joint, edot));
  };
  add(s.largest, "largest ball", 0);
  add(s.fastest, "fastest rate", 2);
  const bool certified = s.largest && s.largest->holds_initial_state();
  panel.curve(certified ? "initial state: certified" : "initial state: not certified",
              "points pt 7 ps 0.8", certified ? 6 : 1, {{s.initial[joint], s.initial[edot]}});
  return panel;
}

}  // namespace

void draw_certificate(const certificate::Certificate& certificate,
                      const experiment::Scenario& scenario, const std::filesystem::path& svg) {
  std::vector<Panel> panels;
  if (certificate.sampled) {
    panels.push_back(period_panel(*certificate.sampled));
    if (!certificate.sampled->along.empty()) panels.push_back(along_panel(*certificate.sampled));
  }
  const auto& stability = certificate.stability;
  if (stability && (stability->largest || stability->fastest)) {
    for (Index joint = 0; joint < stability->system.num_links(); ++joint) {
      panels.push_back(region_panel(*stability, scenario, joint));
    }
  }
  if (panels.empty()) return;
  const std::size_t columns = panels.size() > 4 ? 3 : 2;
  const std::size_t rows = (panels.size() + columns - 1) / columns;
  std::string commands = fmt::format(
      "set terminal svg size {},{} font 'sans,11' background '#ffffff'\n"
      "set multiplot layout {},{} title {} font ',14'\n"
      "set key below horizontal samplen 2\nset grid lc rgb '#dddddd'\nset border 3\nset tics "
      "nomirror\n",
      420 * columns, 320 * rows + 30, rows, columns,
      gnuplot_text(fmt::format("{}: {}", scenario.name, scenario.controller.law_text())));
  for (const Panel& panel : panels) {
    commands +=
        panel.plot.commands(panel.settings) + "unset logscale\nset autoscale\nset xtics autofreq\n";
  }
  draw_file(commands + "unset multiplot\n", svg, "name another file with --plot");
}

}  // namespace tachless::report
