#include "report/report_charts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>

#include "report/axis_cut.h"
#include "report/gnuplot.h"
#include "report/html.h"

namespace tachless::report {
namespace {

constexpr const char* black = "#000000";
constexpr const char* light_blue = palette[5];
constexpr const char* vermilion = palette[1];
// Orange marks nothing but what went wrong.
constexpr const char* alarm = palette[4];

std::string count_of_ticks(std::int64_t count) {
  return std::to_string(count) + (count == 1 ? " tick" : " ticks");
}

std::string formatted(const char* format, double value) {
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

class Charts {
 public:
  explicit Charts(const std::vector<RecordedRun>& runs) : runs_(runs) {
    for (const RecordedRun& run : runs_) {
      num_joints_ = std::max(num_joints_, run.tracking.joints().size());
      const auto ticks = static_cast<double>(run.summary.last_tick + 1);
      end_s_ = std::max(end_s_, ticks * run.info.period_s);
    }
    if (!(end_s_ > 0)) end_s_ = 1;
  }

  std::vector<ReportSection> sections() {
    return {tracking(), error(), torque(), filter(), lyapunov(), timing(), events()};
  }

 private:
  [[nodiscard]] bool alone() const { return runs_.size() == 1; }
  [[nodiscard]] std::size_t budget() const { return alone() ? 1600 : 1000; }
  [[nodiscard]] static std::string colour(std::size_t run) { return run_colour(run); }
  /// Where runs are overlaid, a legend beside the charts names them.
  [[nodiscard]] std::string dash(std::size_t run) const { return alone() ? "" : run_dash(run); }

  [[nodiscard]] std::string joint_heading(std::size_t joint) const {
    std::string text = "Joint " + std::to_string(joint + 1);
    for (const RecordedRun& run : runs_) {
      if (joint < run.joint_names.size()) return text + " · " + run.joint_names[joint];
    }
    return text;
  }

  [[nodiscard]] std::string unit(std::size_t joint, bool effort) const {
    for (const RecordedRun& run : runs_) {
      const auto& units = effort ? run.units.effort : run.units.length;
      if (joint < units.size()) return units[joint];
    }
    return "";
  }

  [[nodiscard]] Chart over_time(const std::string& name, const std::string& caption) const {
    Chart chart;
    chart.name = name;
    chart.caption = caption;
    chart.x_range = {{0, end_s_}};
    return chart;
  }

  static std::string indexed(const char* symbol, std::size_t joint) {
    return std::string("{/:Italic ") + symbol + "}_{" + std::to_string(joint + 1) + "}";
  }

  /// Gives `chart` a place unless nothing is in it.
  static void add(ReportSection& section, const std::string& heading, Chart chart) {
    const bool something =
        !chart.bars.empty() ||
        std::any_of(chart.curves.begin(), chart.curves.end(), [&](const Curve& curve) {
          return std::any_of(curve.points.begin(), curve.points.end(), [&](const Point& point) {
            return std::isfinite(point.y) && (!chart.logarithmic_y || point.y > 0);
          });
        });
    if (something) section.charts.push_back({heading, std::move(chart)});
  }

  static void cut_kick(Chart& chart, const std::string& unit) {
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

  template <class PerRun>
  void for_runs_with_joint(std::size_t joint, const PerRun& visit) const {
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      const auto& joints = runs_[i].tracking.joints();
      if (joint < joints.size() && runs_[i].tracking.num_ticks() > 0) {
        visit(i, runs_[i], joints[joint]);
      }
    }
  }

  [[nodiscard]] ReportSection tracking() const {
    ReportSection section{"tracking", "Tracking", "", {}, "The log holds no positions."};
    section.text =
        "True link positions" +
        std::string(alone() && runs_[0].tracking.has_motors() ? " and motor positions" : "") +
        " against the reference. Curves are drawn by their extremes: every peak of "
        "every tick is in them.";
    for (std::size_t joint = 0; joint < num_joints_; ++joint) {
      Chart chart = over_time(
          "tracking-" + std::to_string(joint + 1),
          "Position of joint " + std::to_string(joint + 1) + " and its reference over time");
      chart.y_label = indexed("q", joint) + "  [" + unit(joint, false) + "]";
      std::vector<Curve> references;
      std::vector<Point> first_reference;
      for_runs_with_joint(joint, [&](std::size_t i, const RecordedRun& run, const auto& signals) {
        if (alone()) {
          chart.curves.push_back(
              {"link", signals.q.points(budget()), light_blue, 4, "", CurveStyle::line});
          if (run.tracking.has_motors()) {
            chart.curves.push_back(
                {"motor", signals.theta.points(budget()), vermilion, 1.2, "", CurveStyle::line});
          }
        } else {
          chart.curves.push_back(
              {"", signals.q.points(budget()), colour(i), 1.6, dash(i), CurveStyle::line});
        }
        const auto points = signals.q_ref.points(budget());
        if (references.empty()) first_reference = points;
        const bool same =
            std::equal(points.begin(), points.end(), first_reference.begin(), first_reference.end(),
                       [](const Point& a, const Point& b) { return a.x == b.x && a.y == b.y; });
        if (references.empty() || !same) {
          references.push_back({references.empty() ? "reference" : "", points,
                                references.empty() ? black : colour(i), 1.3, "(5,4)",
                                CurveStyle::line});
        }
      });
      chart.curves.insert(chart.curves.end(), references.begin(), references.end());
      add(section, joint_heading(joint), chart);
    }
    return section;
  }

  [[nodiscard]] ReportSection error() const {
    ReportSection section{
        "error", "Position error", "", {}, "The error is zero at every tick of the log."};
    section.text =
        "|<i>q</i> − <i>q</i><sub>ref</sub>| on a logarithmic axis. Where its upper envelope falls "
        "along an exponential by at least a factor of two, that is drawn and its rate given (slope "
        "by the median of slopes, between the peak and the instant from which on a constant fits "
        "better).";
    if (!alone()) section.text += " Broad dashes: these exponentials.";
    for (std::size_t joint = 0; joint < num_joints_; ++joint) {
      Chart chart = over_time("error-" + std::to_string(joint + 1),
                              "Absolute position error of joint " + std::to_string(joint + 1) +
                                  " over time, logarithmic");
      chart.y_label = "|" + indexed("e", joint) + "|  [" + unit(joint, false) + "]";
      chart.logarithmic_y = true;
      std::vector<Curve> fits;
      for_runs_with_joint(joint, [&](std::size_t i, const RecordedRun& run, const auto& signals) {
        chart.curves.push_back({alone() ? "|{/:Italic e}|" : "", signals.abs_error.points(budget()),
                                colour(i), 1.2, dash(i), CurveStyle::line});
        if (const auto& decay = run.decay[joint]) fits.push_back(fit(*decay, i));
      });
      finish_logarithmic(chart, fits);
      add(section, joint_heading(joint), chart);
    }
    return section;
  }

  [[nodiscard]] Curve fit(const Decay& decay, std::size_t run) const {
    return {
        runs_.size() <= 3 ? "fit: " + formatted("%.3g", decay.rate_per_s) + " 1/s" : "",
        {{decay.from_s, decay.amplitude},
         {decay.to_s, decay.amplitude * std::exp(-decay.rate_per_s * (decay.to_s - decay.from_s))}},
        alone() ? vermilion : colour(run),
        2.4,
        "(6,4)",
        CurveStyle::line};
  }

  static void finish_logarithmic(Chart& chart, const std::vector<Curve>& fits) {
    if (const auto floor = logarithmic_floor(chart.curves)) {
      chart.y_range = {{*floor, INFINITY}};
    }
    chart.curves.insert(chart.curves.end(), fits.begin(), fits.end());
  }

  [[nodiscard]] ReportSection torque() const {
    ReportSection section{"torque", "Torque", "", {}, "The log holds no torques."};
    bool limited = false;
    bool saturated = false;
    for (std::size_t joint = 0; joint < num_joints_; ++joint) {
      Chart chart =
          over_time("torque-" + std::to_string(joint + 1),
                    "Torque applied to joint " + std::to_string(joint + 1) + " over time");
      chart.y_label = indexed("τ", joint) + "  [" + unit(joint, true) + "]";
      for_runs_with_joint(joint, [&](std::size_t i, const RecordedRun& run, const auto& signals) {
        chart.curves.push_back(
            {"", signals.tau.points(budget()), colour(i), 1.2, dash(i), CurveStyle::line});
        if (const auto& limit = run.scenario.plant.drive.torque_limit_Nm) {
          const double value = (*limit)[static_cast<Eigen::Index>(joint)];
          // A limit far outside would flatten the curve.
          if (std::isfinite(value) && value < 3 * signals.torque.peak()) {
            chart.levels.push_back(value);
            chart.levels.push_back(-value);
            limited = true;
          }
        }
        const double h = run.info.period_s;
        for (const auto& [first, last] : run.saturated[joint].listed()) {
          chart.marks.push_back({static_cast<double>(first) * h, static_cast<double>(last + 1) * h,
                                 alone() ? alarm : colour(i)});
          saturated = true;
        }
      });
      cut_kick(chart, unit(joint, true));
      add(section, joint_heading(joint), chart);
    }
    section.text = "Torque that acted over each tick, after delay and limit.";
    if (limited) section.text += " Dotted: the drive's limit.";
    if (saturated) section.text += " Bars at the top: the command exceeded the limit.";
    return section;
  }

  [[nodiscard]] ReportSection filter() const {
    ReportSection section{
        "filter",
        "Filter state",
        "",
        {},
        "The log holds no filter state: the law has no filter, or its state was not recorded."};
    section.text =
        "<i>ν</i>, the dirty derivative of the position error that stands in for the velocity "
        "which is not measured.";
    const bool motors = std::any_of(runs_.begin(), runs_.end(),
                                    [](const RecordedRun& run) { return run.nu.size() > 1; });
    if (!alone() && motors) section.text += " Thin: that of the motors' error.";
    for (std::size_t joint = 0; joint < num_joints_; ++joint) {
      Chart chart = over_time("filter-" + std::to_string(joint + 1),
                              "Filter output of joint " + std::to_string(joint + 1) + " over time");
      chart.y_label = indexed("ν", joint) + "  [" + unit(joint, false) + "/s]";
      for (std::size_t i = 0; i < runs_.size(); ++i) {
        const auto& nu = runs_[i].nu;
        for (std::size_t row = 0; row < nu.size(); ++row) {
          if (joint >= nu[row].size()) continue;
          std::string title;
          if (alone() && nu.size() > 1) title = row == 0 ? "link" : "motor";
          chart.curves.push_back({title, nu[row][joint].points(budget()), colour(alone() ? row : i),
                                  row == 0 ? 1.2 : 0.7, dash(i), CurveStyle::line});
        }
      }
      cut_kick(chart, unit(joint, false) + "/s");
      add(section, joint_heading(joint), chart);
    }
    return section;
  }

  [[nodiscard]] ReportSection lyapunov() const {
    ReportSection section{"lyapunov", "Lyapunov function", "", {}, ""};
    Chart chart = over_time("lyapunov-v", "Lyapunov function along the run, logarithmic");
    chart.y_label = "{/:Italic V}  [J]";
    chart.logarithmic_y = true;
    chart.wide = true;
    std::vector<Curve> fits;
    std::vector<std::string> says;
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      const RecordedRun& run = runs_[i];
      if (run.lyapunov_formula.empty()) {
        says.push_back("for " + escaped(run.scenario.controller.law) +
                       " no function is evaluated.");
        continue;
      }
      says.push_back("<i>V</i> = " + run.lyapunov_formula);
      if (run.lyapunov_epsilon > 0) {
        says.back() += " with ε = " + formatted("%.3g", run.lyapunov_epsilon) +
                       " 1/s, 5 % of the largest for which V is positive definite by norms";
      }
      says.back() += ", at the plant's true state and the law's own model.";
      chart.curves.push_back(
          {"", run.lyapunov.points(budget()), colour(i), 1.4, dash(i), CurveStyle::line});
      if (run.lyapunov_decay) fits.push_back(fit(*run.lyapunov_decay, i));
    }
    const bool all_alike = std::equal(says.begin() + 1, says.end(), says.begin());
    for (std::size_t i = 0; i < (all_alike ? 1 : says.size()); ++i) {
      section.text += "<p>" + (all_alike ? "" : escaped(runs_[i].label) + ": ") + says[i] + "</p>";
    }
    section.text +=
        "<p>In continuous time V falls to zero; a torque that is held over a tick, an encoder's "
        "counts and a payload keep it above.</p>";
    section.without =
        "There is no V to draw: it takes the true state (TRUTH), the reference and "
        "the controller's state, of a law whose function is known.";
    finish_logarithmic(chart, fits);
    add(section, "", chart);
    return section;
  }

  /// The outline of a histogram in steps of a quarter octave, in percent.
  static std::vector<Point> outline(const nlohmann::json& histogram) {
    constexpr double per_octave = 4;
    std::map<int, double> counts;
    double total = 0;
    for (const auto& bucket : histogram) {
      if (!bucket.is_array() || bucket.size() != 2 || !bucket[0].is_number() ||
          !bucket[1].is_number()) {
        continue;
      }
      const double from_us = std::max(bucket[0].get<double>(), 1e-3);
      const double count = bucket[1].get<double>();
      counts[static_cast<int>(std::floor(per_octave * std::log2(from_us) + 1e-9))] += count;
      total += count;
    }
    if (!(total > 0)) return {};
    const double floor = 50 / total;
    std::vector<Point> points;
    for (const auto& [bin, count] : counts) {
      const double from = std::exp2(bin / per_octave);
      const double to = std::exp2((bin + 1) / per_octave);
      const double share = 100 * count / total;
      if (points.empty() || from > points.back().x * 1.0001) points.push_back({from, floor});
      points.insert(points.end(), {{from, share}, {to, share}});
      if (!counts.contains(bin + 1)) points.push_back({to, floor});
    }
    return points;
  }

  [[nodiscard]] ReportSection timing() const {
    ReportSection section{"timing", "Timing", "", {}, ""};
    section.without =
        "No summary.json of this run with times in it lies beside the log; a log itself has none.";
    section.text =
        "From a tick's question to its command; in realtime also from a measurement to its "
        "command, and from a tick's deadline to the plant's beginning it: how many of all ticks "
        "(logarithmic) took how long.";
    const std::vector<std::array<const char*, 3>> kinds = {
        {"round_trip_us", "round-trip", "Round trip"}, {"wake_up_us", "wake-up", "Wake-up jitter"}};
    for (const auto& [key, name, heading] : kinds) {
      Chart chart;
      chart.name = name;
      chart.caption = std::string(heading) + " times: histogram";
      chart.x_label = "time [µs]";
      chart.y_label = "ticks  [%]";
      chart.logarithmic_x = true;
      chart.logarithmic_y = true;
      for (std::size_t i = 0; i < runs_.size(); ++i) {
        const nlohmann::json& outcome = runs_[i].outcome;
        if (!outcome.is_object() || !outcome.contains(key) || !outcome[key].is_object() ||
            !outcome[key].contains("histogram")) {
          continue;
        }
        chart.curves.push_back(
            {"", outline(outcome[key]["histogram"]), colour(i), 1.6, dash(i), CurveStyle::line});
      }
      double floor = INFINITY;
      for (const Curve& curve : chart.curves) {
        for (const Point& point : curve.points) floor = std::min(floor, point.y);
      }
      if (std::isfinite(floor)) chart.y_range = {{floor, INFINITY}};
      add(section, heading, chart);
    }
    return section;
  }

  [[nodiscard]] ReportSection events() const {
    ReportSection section{"events", "Events and faults", "", {}, ""};
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      const RecordedRun& run = runs_[i];
      Chart chart = over_time("events-" + std::to_string(i + 1),
                              "When torques saturated, commands were missed and records lack");
      chart.wide = true;
      const double h = run.info.period_s;
      const auto bar = [&](const std::string& name, const std::vector<logger::TickRange>& ranges,
                           const char* paint) {
        if (ranges.empty()) return;
        Bars bars{name, {}, paint};
        for (const auto& [first, last] : ranges) {
          bars.stretches.emplace_back(static_cast<double>(first) * h,
                                      static_cast<double>(last + 1) * h);
        }
        chart.bars.push_back(bars);
      };
      for (std::size_t joint = 0; joint < run.saturated.size(); ++joint) {
        bar("saturated " + std::to_string(joint + 1), run.saturated[joint].listed(), alarm);
      }
      bar("missed", run.command_missed.listed(), palette[3]);
      bar("stopped", run.protective_stop.listed(), vermilion);
      for (const auto& piece : run.summary.pieces) {
        if (!piece.absent()) bar("no " + suffix(piece.channel, run), piece.missing_list, "#777777");
      }
      std::vector<logger::TickRange> faults;
      for (const auto& fault : run.summary.faults) faults.push_back({fault.tick, fault.tick});
      bar("fault", faults, black);
      if (chart.bars.empty()) {
        section.text += "<p>" + (alone() ? "" : escaped(run.label) + ": ") +
                        "No torque saturated, no command was missed, nothing is missing from the "
                        "log, no process reported a fault.</p>";
      }
      section.text += events_text(run);
      add(section, alone() ? "" : run.label, chart);
    }
    return section;
  }

  static std::string suffix(const std::string& channel, const RecordedRun& run) {
    return channel.starts_with(run.info.robot + "_") ? channel.substr(run.info.robot.size() + 1)
                                                     : channel;
  }

  [[nodiscard]] std::string events_text(const RecordedRun& run) const {
    std::vector<std::string> lines;
    const double ticks = std::max<double>(1, static_cast<double>(run.summary.ticks));
    const auto count = [&](const std::string& what, const Stretches& stretches) {
      if (stretches.ticks() == 0) return;
      lines.push_back(what + " in " + count_of_ticks(stretches.ticks()) + " (" +
                      formatted("%.3g", 100 * static_cast<double>(stretches.ticks()) / ticks) +
                      " %)" + (stretches.cut() ? ", of which the first stretches are drawn" : ""));
    };
    for (std::size_t joint = 0; joint < run.saturated.size(); ++joint) {
      count("Torque of joint " + std::to_string(joint + 1) + " saturated", run.saturated[joint]);
    }
    count("Command missed, the torque before held,", run.command_missed);
    count("Protective stop", run.protective_stop);
    for (const auto& piece : run.summary.pieces) {
      if (piece.absent() || piece.missing == 0) continue;
      lines.push_back("No " + escaped(piece.channel) + " in " +
                      count_of_ticks(static_cast<std::int64_t>(piece.missing)));
    }
    for (const auto& fault : run.summary.faults) {
      lines.push_back("Fault of the " + std::string(loop::name(fault.role)) + " at tick " +
                      std::to_string(fault.tick) + ": " + escaped(fault.text));
    }
    if (lines.empty()) return "";
    std::string text = alone() ? "" : "<p>" + escaped(run.label) + ":</p>";
    text += "<ul>";
    for (const std::string& line : lines) text += "<li>" + line + "</li>";
    return text + "</ul>\n";
  }

  const std::vector<RecordedRun>& runs_;
  std::size_t num_joints_ = 0;
  double end_s_ = 0;
};

}  // namespace

std::string run_colour(std::size_t run) { return palette[run % palette.size()]; }

std::string run_dash(std::size_t run) {
  constexpr std::array<const char*, 4> dashes = {"", "(8,3)", "(3,2)", "(8,3,2,3)"};
  return dashes[run / palette.size() % dashes.size()];
}

std::vector<ReportSection> report_sections(const std::vector<RecordedRun>& runs) {
  return Charts(runs).sections();
}

}  // namespace tachless::report
