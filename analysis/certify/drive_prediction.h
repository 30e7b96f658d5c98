#pragma once

#include <string>

#include "base/quantities.h"
#include "linear/drive_loop.h"
#include "linear/scenario_loop.h"
#include "scenario/scenario.h"

/// The loop inside the drives (plant.drive.loop) while the host's loop is closed around it.
namespace tachless::certify {

/// Number of postures, spread evenly over the reference, at which margins are computed.
inline constexpr int drive_postures = 5;

/// Margins of the drives' loop, and torques of encoder counts.
struct DrivePrediction {
  linear::DriveMargins margins;  ///< the least of each margin over the postures
  double delay_s = 0;            ///< `margins.delay_ticks` as a time [s]
  /// Largest delay by which the host's torques may come later, the least over the postures [s].
  double host_delay_s = 0;
  bool host_delay_ends = false;  ///< false: no limit was found up to `host_delay_s`
  Vector count_Nm;               ///< torque of one count of the drives' encoders; 0: ideal
};

/// Returns the prediction of a scenario with plant.drive.loop.
/// @param answers answers of an external law; empty: the law is in the catalogue
DrivePrediction predict_drives(const scenario::Scenario& scenario,
                               const linear::LawAnswers& answers = {});

/// Returns a text such as "modulus 0.71; gain 88, delay 17 ms of a drive".
std::string margins_text(const DrivePrediction& drives);
/// Returns a text such as "the host's torques may come 12 ms later".
std::string host_delay_text(const DrivePrediction& drives);

}  // namespace tachless::certify
