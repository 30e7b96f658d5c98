#pragma once

#include <optional>
#include <string>
#include <vector>

#include "report/chart.h"
#include "report/figure.h"
#include "report/html.h"
#include "report/recorded_run.h"
#include "robot/model.h"
#include "study/tracking.h"

/// Contents of a run's figures and pages: the charts of tracking.svg, and a report's sections,
/// tables and warnings. The sections have texts and charts of one run, or of several runs on the
/// same axes. The tables have one column or row per run. Nothing is drawn and no page is written
/// here.
namespace tachless::report {

/// Returns the figure of a run: link angle and reference for each joint, position error on a
/// logarithmic axis, torque. A flexible joint has its motor angle too.
/// @param title scenario, law and period
/// @param end_s end of the time axis
/// @param max_points of a curve: two points per pixel of the figure's width show every peak
Figure tracking_figure(const study::Tracking& tracking, const std::string& title, double end_s,
                       const robot::JointLabels& joints, std::size_t max_points = 1600);

/// A heading of a report with the charts under it.
struct ReportSection {
  std::string name;     ///< anchor in the page
  std::string heading;  ///< plain text
  std::string without;  ///< replaces the charts when there is nothing to draw; plain text
  Html text = {};       ///< paragraphs and lists that explain the charts
  std::vector<Chart> charts = {};

  /// Adds `chart` unless it shows nothing.
  void add(Chart chart);
};

/// Common properties of several runs' charts on the same axes. Joints of the same name belong
/// together. Joints are numbered in the order of their first appearance among the runs.
struct Overlay {
  explicit Overlay(const std::vector<RecordedRun>& labelled);

  const std::vector<RecordedRun>& runs;
  std::vector<std::string> joints;  ///< names of the joints
  bool numbered_alike = true;       ///< all runs give the joints the same numbers
  double end_s = 0;                 ///< end of the longest run
  bool live = false;                ///< the run is in progress; its points come later
  std::size_t budget = 0;           ///< largest number of points of a curve

  [[nodiscard]] bool alone() const { return runs.size() == 1; }
  /// Returns the number that `run` itself gives to the joint, or nothing if it has no joint of that
  /// name.
  [[nodiscard]] std::optional<std::size_t> joint_of(const RecordedRun& run,
                                                    std::size_t joint) const;
  [[nodiscard]] Chart over_time(const std::string& name, const std::string& caption) const;
  /// Returns a curve of `run`. If runs are overlaid, a legend beside the charts names them.
  [[nodiscard]] Curve curve(const RecordedRun& run, const std::vector<study::Point>& points,
                            const std::string& signal, Label label = {}, double width = 1.2) const;
};

/// Returns the sections: tracking, error, torque, contact (with plant.mujoco), torque of the model,
/// controller signals, Lyapunov function, timing, events.
std::vector<ReportSection> report_sections(const Overlay& all);

/// Return the last three sections: V along the run and its certified bound; histograms of times
/// from the runs' summary.json; saturation, missed commands, missing records and faults, per run.
ReportSection lyapunov_section(const Overlay& all);
ReportSection timing_section(const Overlay& all);
ReportSection events_section(const Overlay& all);

// The colour of faults on charts.
inline constexpr const char* alarm_colour = "#E69F00";

/// Returns the exponential that was fitted to a curve of `run`, as broad dashes.
Curve fitted(const Overlay& all, const Decay& decay, const RecordedRun& run);

/// Returns the table of facts that the curves do not show: scenario, law, gains, sampling and the
/// run's end. Marks the values that differ from the first run's.
Html facts_table(const std::vector<RecordedRun>& runs);

/// Returns the differences between several runs: the scenario's keys as they were written, and
/// robots with other joints. Empty for one run.
Html differences(const std::vector<RecordedRun>& runs);

/// Returns a table of errors, torques and decay per joint.
Html results_table(const std::vector<RecordedRun>& runs);

/// Returns the verdict of each run, one line per run.
Html verdicts(const std::vector<RecordedRun>& runs);

/// Returns warnings of damaged logs; empty when there are none.
Html alarms(const std::vector<RecordedRun>& runs);

/// Returns a sample of the line of the run's curves.
Html swatch(const RecordedRun& run);

}  // namespace tachless::report
