#pragma once

#include <string>

#include "report/chart.h"
#include "robot/joint_labels.h"
#include "study/tracking.h"

/// The charts of one run's signals: those of tracking.svg, and the one that a report has too.
namespace tachless::report {

/// Link angle, motor angle where there is one, and reference of one joint, named and labelled.
Chart position_chart(const study::Tracking& tracking, std::size_t joint, const std::string& name,
                     const std::string& unit, std::size_t max_points);

/// gnuplot commands and data for the figure of a run: link angle against reference for each joint
/// (the motor angle too where there is one), position error on a logarithmic axis, torque.
/// @param title scenario, law and period
std::string tracking_figure(const study::Tracking& tracking, const std::string& title,
                            double period_s, const robot::JointLabels& joints);

}  // namespace tachless::report
