#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "report/gnuplot.h"
#include "report/tracking.h"

namespace tachless::report {

struct FigureFacts {
  std::string title;  ///< scenario, law and period
  double period_s = 0;
  std::vector<std::string> length_units;  ///< per joint: "rad" or "m"
  std::vector<std::string> effort_units;  ///< per joint: "N m" or "N"
};

/// gnuplot commands and data for the figure of a run: link angle against reference for each joint
/// (the motor angle too where there is one), position error on a logarithmic axis, torque.
std::string tracking_figure(const Tracking& tracking, const FigureFacts& facts,
                            const std::filesystem::path& svg);

}  // namespace tachless::report
