#pragma once

#include <Eigen/Core>
#include <optional>

/// Rows of a table in which a number does not fit those around it. One such row may change every
/// parameter by more than its interval.
namespace tachless::identify {

/// A number that does not fit its neighbours.
struct Spike {
  Eigen::Index row = 0;
  double off = 0;  ///< how far it is from what its neighbours say
};

/// Returns the largest spike of a position, or nothing. A position is smooth: the cubic through two
/// rows before and two rows after predicts it. A spike is off by more than 20 standard deviations
/// of that prediction, by more than 1 % of the motion, and by more than 5 mrad (mm).
/// @param rows evenly spaced in time
std::optional<Spike> position_spike(const Eigen::VectorXd& rows);

/// Returns the largest spike of a torque, or nothing. A torque may jump, at a reversal by twice
/// Coulomb's friction, but it then stays: the median of five rows follows it. A spike is off from
/// it by more than 20 standard deviations, by more than half of the range in which 98 of 100 rows
/// are, and by more than 5 times the range of the four rows around it.
/// @param rows in order of time
std::optional<Spike> torque_spike(const Eigen::VectorXd& rows);

}  // namespace tachless::identify
