#pragma once

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
};

/// A heading of a report and the charts under it.
struct ReportSection {
  std::string name;     ///< of its anchor
  std::string heading;  ///< plain text
  Html text;            ///< what is to be seen: paragraphs, lists
  std::vector<ReportChart> charts;
  std::string without;  ///< in place of charts when there is nothing to draw; plain text

  /// Takes `chart` unless there is nothing to be seen in it.
  void add(const std::string& chart_heading, Chart chart);
};

/// Several runs on the same axes: what their charts have in common. Draws nothing.
class Overlay {
 public:
  explicit Overlay(const std::vector<RecordedRun>& runs);

  [[nodiscard]] const std::vector<RecordedRun>& runs() const { return runs_; }
  [[nodiscard]] std::size_t num_joints() const { return num_joints_; }
  [[nodiscard]] bool alone() const { return runs_.size() == 1; }
  /// Points of a curve at most.
  [[nodiscard]] std::size_t budget() const { return alone() ? 1600 : 1000; }
  /// Where runs are overlaid, a legend beside the charts names them.
  [[nodiscard]] std::string dash(std::size_t run) const { return alone() ? "" : dash_of(run); }
  [[nodiscard]] Curve curve(std::size_t run, const std::vector<study::Point>& points,
                            const std::string& title = "", double width = 1.2) const;

  [[nodiscard]] std::string joint_heading(std::size_t joint) const;
  /// Of the first run that has this joint.
  [[nodiscard]] std::string length_unit(std::size_t joint) const;
  [[nodiscard]] std::string effort_unit(std::size_t joint) const;
  [[nodiscard]] Chart over_time(const std::string& name, const std::string& caption) const;

  /// Calls `visit(i, run, tracking of the joint)` for each run that tracks the joint.
  template <class Visit>
  void for_runs_with_joint(std::size_t joint, const Visit& visit) const {
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      const auto& joints = runs_[i].tracking.joints();
      if (joint < joints.size() && runs_[i].tracking.num_ticks() > 0) {
        visit(i, runs_[i], joints[joint]);
      }
    }
  }

 private:
  const std::vector<RecordedRun>& runs_;
  std::size_t num_joints_ = 0;
  double end_s_ = 0;
};

}  // namespace tachless::report
