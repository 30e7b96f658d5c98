#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "report/chart.h"
#include "robot/joint_labels.h"
#include "study/tracking.h"

/// The charts of one run's signals: those of tracking.svg, and the pieces that the report's charts
/// are made of too.
namespace tachless::report {

/// gnuplot's enhanced text for a symbol with a joint's number, and its name if that is given:
/// q_1 shoulder. Of a long name its end.
std::string indexed(std::string_view symbol, std::size_t joint, std::string_view name = {});

/// Link angle, motor angle where there is one, and reference of one joint, named and labelled.
Chart position_chart(const study::Tracking& tracking, std::size_t joint, const std::string& name,
                     const std::string& unit, std::size_t max_points);

/// Where a kick would flatten the rest of a chart's curves, its axis is cut, and a note says so.
void cut_kick(Chart& chart, const std::string& unit);

/// Makes the ordinate logarithmic, from a floor that leaves out where curves swing through zero.
void make_logarithmic(Chart& chart);

struct FigureFacts {
  std::string title;  ///< scenario, law and period
  double period_s = 0;
  robot::JointLabels joints;
};

/// gnuplot commands and data for the figure of a run: link angle against reference for each joint
/// (the motor angle too where there is one), position error on a logarithmic axis, torque.
std::string tracking_figure(const study::Tracking& tracking, const FigureFacts& facts,
                            const std::filesystem::path& svg);

}  // namespace tachless::report
