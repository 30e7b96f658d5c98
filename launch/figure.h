#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "launch/tracking.h"

namespace launch {

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

/// Draws it with gnuplot into `svg`.
/// @throw app::Failure(bad_usage) when gnuplot cannot be started or refuses.
void draw(const std::string& gnuplot_commands, const std::filesystem::path& svg);

}  // namespace launch
