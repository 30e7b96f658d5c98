#include "report/figure.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "report/axis_cut.h"

namespace tachless::report {
namespace {

constexpr const char* link_colour = "#56B4E9";
constexpr const char* motor_colour = "#D55E00";
constexpr int width_px = 900;
constexpr int row_px = 200;
constexpr int key_px = 22;    // above each panel
constexpr int below_px = 14;  // below each panel
constexpr int title_px = 32;
constexpr int foot_px = 54;
constexpr int tics_px = 24;  // under the joints' panels where they have a time axis of their own

std::string data_block(const std::string& name, const Envelope& curve, bool positive_only = false) {
  std::string text = "$" + name + " << END\n";
  char row[64];
  for (const Point& point : curve.points()) {
    if (positive_only && !(point.y > 0)) continue;
    std::snprintf(row, sizeof row, "%.8g %.6g\n", point.x, point.y);
    text += row;
  }
  return text + "END\n";
}

std::string common_unit(const std::vector<std::string>& units) {
  const bool same = std::all_of(units.begin(), units.end(),
                                [&](const std::string& unit) { return unit == units.front(); });
  return same ? units.front()
              : units.front() + ", " +
                    *std::find_if(units.begin(), units.end(),
                                  [&](const std::string& unit) { return unit != units.front(); });
}

// The lower end of a logarithmic error axis: the error of a joint that swings through its
// reference dips towards zero, and the dips would squeeze everything else.
double lower_limit(const std::vector<JointTracking>& joints) {
  std::vector<double> values;
  for (const JointTracking& joint : joints) {
    for (const Point& point : joint.abs_error.points()) {
      if (point.y > 0) values.push_back(point.y);
    }
  }
  const auto quantile = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 50);
  std::nth_element(values.begin(), quantile, values.end());
  return std::pow(10, std::floor(std::log10(*quantile) - 0.3));
}

/// Where a kick would flatten the rest of the run, the axis is cut and says so.
std::string cut_axis(const Range& whole, const Range& usual, const std::string& unit) {
  const auto cut = cut_at_kick(whole, usual);
  if (!cut) return "set autoscale y\nunset label 2\n";
  return "set yrange [" + gnuplot_number(cut->low) + ":" + gnuplot_number(cut->high) +
         "]\nset label 2 " + gnuplot_string(cut_note(whole, unit)) +
         " at graph 0.99, graph 0.94 right font ',12' textcolor '#555555' front\n";
}

/// Places panels by hand: gnuplot's own layout gives panels with wide tic labels less width, and
/// their time axes would not line up.
class Panels {
 public:
  Panels(int num_joints, int columns)
      : columns_(columns), joint_rows_((num_joints + columns - 1) / columns) {}

  [[nodiscard]] int height_px() const { return row_top(joint_rows_ + 2) + foot_px; }

  /// The panel of a joint.
  [[nodiscard]] std::string joint(int i) const {
    const bool time_axis = columns_ > 1 && i / columns_ == joint_rows_ - 1;
    return place(i / columns_, i % columns_, columns_) + time(time_axis, false);
  }

  /// A panel under those of the joints, over the whole width.
  [[nodiscard]] std::string wide(int i) const {
    return place(joint_rows_ + i, 0, 1) + time(i == 1, i == 1);
  }

 private:
  [[nodiscard]] int row_top(int row) const {
    return title_px + row * row_px + (columns_ > 1 && row >= joint_rows_ ? tics_px : 0);
  }

  [[nodiscard]] std::string place(int row, int column, int columns) const {
    const double height = height_px();
    const double cell = static_cast<double>(width_px) / columns;
    char text[256];
    std::snprintf(text, sizeof text,
                  "set lmargin at screen %.4f\nset rmargin at screen %.4f\n"
                  "set tmargin at screen %.4f\nset bmargin at screen %.4f\n",
                  (column * cell + 92) / width_px, ((column + 1) * cell - 20) / width_px,
                  1 - (row_top(row) + key_px) / height,
                  1 - (row_top(row) + row_px - below_px) / height);
    return text;
  }

  static std::string time(bool tics, bool label) {
    return std::string(tics ? "set format x '%g'\n" : "set format x ''\n") +
           (label ? "set xlabel 'time [s]' offset 0,0.2\n" : "unset xlabel\n");
  }

  int columns_;
  int joint_rows_;
};

}  // namespace

std::string tracking_figure(const Tracking& tracking, const FigureFacts& facts,
                            const std::filesystem::path& svg) {
  const auto& joints = tracking.joints();
  const int num_joints = static_cast<int>(joints.size());
  const int columns = num_joints <= 3 ? 1 : 2;
  const Panels panels(num_joints, columns);

  const auto has_error = [](const JointTracking& joint) { return joint.error.peak() > 0; };
  const bool logarithmic = std::any_of(joints.begin(), joints.end(), has_error);

  std::string text;
  for (int i = 0; i < num_joints; ++i) {
    const JointTracking& joint = joints[static_cast<std::size_t>(i)];
    const std::string index = std::to_string(i + 1);
    text += data_block("q" + index, joint.q) + data_block("r" + index, joint.q_ref) +
            data_block("e" + index, joint.abs_error, logarithmic) +
            data_block("u" + index, joint.tau);
    if (tracking.has_motors()) text += data_block("m" + index, joint.theta);
  }

  text += "set terminal svg size " + std::to_string(width_px) + "," +
          std::to_string(panels.height_px()) +
          " dynamic enhanced font 'Helvetica,Arial,sans-serif,14' background '#ffffff'\n";
  text += "set output " + gnuplot_string(svg.string()) + "\n";
  text +=
      "set encoding utf8\n"
      "set border 3 linecolor '#444444'\n"
      "set tics nomirror out scale 0.6 textcolor '#222222'\n"
      "set grid xtics ytics linetype 1 linewidth 0.5 linecolor '#dddddd'\n"
      "set minussign\n"
      "set key at graph 1.0, graph 1.02 right bottom horizontal maxrows 1 reverse Left samplen "
      "2.5\n"
      "set ylabel offset 0.5,0\n";
  text += "set xrange [0:" +
          gnuplot_number(static_cast<double>(tracking.num_ticks()) * facts.period_s) + "]\n";
  text += "set multiplot\n";
  text += "set label 1 " + gnuplot_text(facts.title) + " at screen 0.012, screen " +
          std::to_string(1 - 16.0 / panels.height_px()) + " left font ',15' front\n";

  for (int i = 0; i < num_joints; ++i) {
    const JointTracking& joint = joints[static_cast<std::size_t>(i)];
    const std::string index = std::to_string(i + 1);
    text += panels.joint(i);
    text += "set ylabel '{/:Italic q}_{" + index + "}" +
            (tracking.has_motors() ? ", {/:Italic θ}_{" + index + "}" : "") + "  [" +
            facts.length_units[static_cast<std::size_t>(i)] + "]'\n";
    // The link is never cut, its motor may be.
    const Range link = join(range_of(joint.q.points()), range_of(joint.q_ref.points()));
    if (tracking.has_motors()) {
      text += cut_axis(join(link, range_of(joint.theta.points())),
                       join(link, usual_range(joint.theta.points())),
                       facts.length_units[static_cast<std::size_t>(i)]);
    }
    text += "plot $q" + index + " with lines linewidth 4 linecolor rgb '" + link_colour +
            "' title 'link'";
    if (tracking.has_motors()) {
      text += ", $m" + index + " with lines linewidth 1.2 linecolor rgb '" + motor_colour +
              "' title 'motor'";
    }
    text += ", $r" + index +
            " with lines linewidth 1.4 dashtype (6,4) linecolor rgb '#000000' title 'reference'\n";
    text += "unset label 1\n";
  }

  const auto overlay = [&](const std::string& block, const std::string& symbol, const auto& shown) {
    std::string plot;
    for (int i = 0; i < num_joints; ++i) {
      if (!shown(joints[static_cast<std::size_t>(i)])) continue;
      const std::string index = std::to_string(i + 1);
      plot += (plot.empty() ? "plot $" : ", $") + block + index +
              " with lines linewidth 1.3 linecolor rgb '" +
              palette[static_cast<std::size_t>(i) % palette.size()] + "' title '" + symbol + "_{" +
              index + "}'";
    }
    return plot + "\n";
  };

  text += panels.wide(0);
  text += "unset label 2\n";
  text += "set ylabel '|{/:Italic q} − {/:Italic q}_{ref}|  [" + common_unit(facts.length_units) +
          "]'\n";
  text += logarithmic ? "set logscale y\nset format y '10^{%T}'\nset yrange [" +
                            gnuplot_number(lower_limit(joints)) + ":*]\n"
                      : "set yrange [0:1]\n";
  text += overlay("e", "{/:Italic e}",
                  [&](const JointTracking& joint) { return !logarithmic || has_error(joint); });
  text += "unset logscale y\nset format y '%g'\nset autoscale y\n";

  text += panels.wide(1);
  text += "set ylabel '{/:Italic τ}  [" + common_unit(facts.effort_units) + "]'\n";
  Range whole_torque = range_of(joints.front().tau.points());
  Range usual_torque = usual_range(joints.front().tau.points());
  for (const JointTracking& joint : joints) {
    whole_torque = join(whole_torque, range_of(joint.tau.points()));
    usual_torque = join(usual_torque, usual_range(joint.tau.points()));
  }
  text += cut_axis(whole_torque, usual_torque, common_unit(facts.effort_units));
  text += overlay("u", "{/:Italic τ}", [](const JointTracking&) { return true; });
  text += "unset multiplot\nunset output\n";
  return text;
}

}  // namespace tachless::report
