#pragma once

#include <optional>
#include <string>
#include <vector>

#include "report/chart.h"
#include "report/html.h"
#include "report/recorded_run.h"

namespace tachless::report {

// Orange marks nothing but what went wrong.
inline constexpr const char* alarm_colour = "#E69F00";

struct ReportChart {
  std::string heading;  ///< "Joint 1 · shoulder"; plain text
  Chart chart;
  std::size_t run = 0;  ///< whose, where a chart is of one run
};

/// A heading of a report and the charts under it.
struct ReportSection {
  std::string name;     ///< of its anchor
  std::string heading;  ///< plain text
  Html text;            ///< what is to be seen: paragraphs, lists
  std::vector<ReportChart> charts;
  std::string without;  ///< in place of charts when there is nothing to draw; plain text

  /// Takes `chart` unless there is nothing to be seen in it.
  void add(const std::string& chart_heading, Chart chart, std::size_t run = 0);
};

/// How many points a curve gets: what paper resolves, or what zooming in shows.
enum class Detail { paper, screen };

/// Several runs on the same axes: what their charts have in common. Joints belong together by name;
/// they are numbered as they first appear among the runs. Draws nothing.
class Overlay {
 public:
  Overlay(const std::vector<RecordedRun>& runs, Detail detail);

  [[nodiscard]] const std::vector<RecordedRun>& runs() const { return runs_; }
  [[nodiscard]] std::size_t num_joints() const { return joints_.size(); }
  /// The number that `run` itself gives to the joint; nothing when it has none of that name.
  [[nodiscard]] std::optional<std::size_t> joint_of(std::size_t run, std::size_t joint) const;
  [[nodiscard]] bool alone() const { return runs_.size() == 1; }
  /// When the longest run ends [s].
  [[nodiscard]] double end_s() const { return end_s_; }
  /// Points of a curve at most.
  [[nodiscard]] std::size_t budget() const { return budget_; }
  /// Where runs are overlaid, a legend beside the charts names them.
  [[nodiscard]] std::string dash(std::size_t run) const { return alone() ? "" : dash_of(run); }
  [[nodiscard]] Curve curve(std::size_t run, const std::vector<study::Point>& points,
                            const std::string& signal, const std::string& title = "",
                            double width = 1.2) const;

  /// As gnuplot's enhanced text; with its number where all runs number the joint alike.
  [[nodiscard]] std::string symbol(std::string_view symbol, std::size_t joint) const;
  [[nodiscard]] std::string joint_heading(std::size_t joint) const;
  /// Of the first run that has this joint.
  [[nodiscard]] std::string length_unit(std::size_t joint) const;
  [[nodiscard]] std::string effort_unit(std::size_t joint) const;
  [[nodiscard]] Chart over_time(const std::string& name, const std::string& caption) const;

  /// Calls `visit(i, run, the run's own number of the joint)` for each run that tracks the joint.
  template <class Visit>
  void for_runs_with_joint(std::size_t joint, const Visit& visit) const {
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      const auto own = joint_of(i, joint);
      if (own && runs_[i].tracking.num_ticks() > 0) visit(i, runs_[i], *own);
    }
  }

 private:
  const std::vector<RecordedRun>& runs_;
  std::vector<std::string> joints_;  ///< names
  bool numbered_alike_ = true;
  std::size_t budget_ = 0;
  double end_s_ = 0;
};

}  // namespace tachless::report
