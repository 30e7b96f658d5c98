#pragma once

#include <string>
#include <vector>

#include "report/chart.h"
#include "report/recorded_run.h"

namespace tachless::report {

struct ReportChart {
  std::string heading;  ///< "Joint 1 · shoulder"; plain text
  Chart chart;
};

/// A heading of a report and the charts under it.
struct ReportSection {
  std::string name;  ///< of its anchor
  std::string heading;
  std::string text;  ///< what is to be seen; HTML
  std::vector<ReportChart> charts;
  std::string without;  ///< in place of charts when there is nothing to draw; HTML
};

/// How the curves of run `run` are drawn where several are overlaid.
std::string run_colour(std::size_t run);
std::string run_dash(std::size_t run);  ///< gnuplot's, empty: solid

/// Tracking, error, torque, filter, Lyapunov function, timing, events. Several runs are overlaid;
/// `runs` are labelled.
std::vector<ReportSection> report_sections(const std::vector<RecordedRun>& runs);

}  // namespace tachless::report
