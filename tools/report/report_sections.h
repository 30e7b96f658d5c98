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

/// What a run's figures and pages consist of: the charts of tracking.svg; a report's sections, with
/// texts and charts of one run, or of several on the same axes; its tables and warnings, with one
/// column or row per run where there are several. Draws nothing and writes no page.
namespace tachless::report {

/// The figure of a run: link angle against reference for each joint (the motor angle too where
/// there is one), position error on a logarithmic axis, torque.
/// @param title scenario, law and period  @param end_s of the time axis
/// @param max_points of a curve: two for each pixel of the figure's width show every peak
Figure tracking_figure(const study::Tracking& tracking, const std::string& title, double end_s,
                       const robot::JointLabels& joints, std::size_t max_points = 1600);

/// A heading of a report and the charts under it.
struct ReportSection {
  std::string name;     ///< of its anchor
  std::string heading;  ///< plain text
  std::string without;  ///< in place of charts when there is nothing to draw; plain text
  Html text = {};       ///< what is to be seen: paragraphs, lists
  std::vector<Chart> charts = {};

  /// Takes `chart` unless there is nothing to be seen in it.
  void add(Chart chart);
};

/// Several runs on the same axes: what their charts have in common. Joints belong together by name;
/// they are numbered as they first appear among the runs.
struct Overlay {
  explicit Overlay(const std::vector<RecordedRun>& labelled);

  const std::vector<RecordedRun>& runs;
  std::vector<std::string> joints;  ///< names
  bool numbered_alike = true;       ///< all runs give the joints the same numbers
  double end_s = 0;                 ///< when the longest run ends
  bool live = false;                ///< the run goes on; its points come later
  std::size_t budget = 0;           ///< points of a curve at most

  [[nodiscard]] bool alone() const { return runs.size() == 1; }
  /// The number that `run` itself gives to the joint; nothing when it has none of that name.
  [[nodiscard]] std::optional<std::size_t> joint_of(const RecordedRun& run,
                                                    std::size_t joint) const;
  [[nodiscard]] Chart over_time(const std::string& name, const std::string& caption) const;
  /// Where runs are overlaid, a legend beside the charts names them.
  [[nodiscard]] Curve curve(const RecordedRun& run, const std::vector<study::Point>& points,
                            const std::string& signal, Label label = {}, double width = 1.2) const;
};

/// Tracking, error, torque, that of the model, controller signals, Lyapunov function, timing,
/// events. `runs` are labelled.
std::vector<ReportSection> report_sections(const Overlay& all);

/// The last three of them: V along the run and its certified bound; histograms of times, from the
/// runs' summary.json; saturation, missed commands, missing records and faults, per run.
ReportSection lyapunov_section(const Overlay& all);
ReportSection timing_section(const Overlay& all);
ReportSection events_section(const Overlay& all);

// Orange marks nothing but what went wrong.
inline constexpr const char* alarm_colour = "#E69F00";

/// The exponential that was fitted to a curve of `run`, as broad dashes.
Curve fitted(const Overlay& all, const Decay& decay, const RecordedRun& run);

/// Of a run, what is not in its curves: scenario, law, gains, sampling, how it ended. Marks what
/// is not as in the first run.
Html facts_table(const std::vector<RecordedRun>& runs);

/// What several runs do not have in common: the scenario's keys as they were written, and robots
/// with other joints. Empty for one run.
Html differences(const std::vector<RecordedRun>& runs);

/// Errors, torques and decay per joint.
Html results_table(const std::vector<RecordedRun>& runs);

/// What each run came to, in a line.
Html verdicts(const std::vector<RecordedRun>& runs);

/// Logs that are damaged; empty when there are none.
Html alarms(const std::vector<RecordedRun>& runs);

/// A sample of the line by which the run's curves are known.
Html swatch(const RecordedRun& run);

}  // namespace tachless::report
