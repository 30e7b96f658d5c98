#pragma once

#include <Eigen/Core>

#include "identify/parameters.h"
#include "robot/model.h"

/// Physically possible links. The pseudo-inertia of a link, (1/2 tr(I) 1 - I, m c; (m c)', m),
/// equals U U' with U upper triangular and a positive diagonal. Every set of ten numbers for U
/// gives a possible link (C. Rucker, P. Wensing, Smooth parameterization of rigid-body inertia,
/// IEEE Robotics and Automation Letters 7(2), 2022).
namespace tachless::identify {

/// Values of the parameters, and how well they were known before.
struct PossibleValues {
  Eigen::VectorXd values;
  /// Rows R of the prior at the values: it takes the numbers R times the error of the parameters
  /// for independent, with standard deviation 1. Parameters without a prior have zero columns.
  Eigen::MatrixXd prior;
};

/// Returns the values x that minimise x'N x / 2 - b'x. Parameters with
/// `Parameters::Entry::not_negative` are at least zero, and every link is physically possible. Link
/// parameters that torques do not determine stay near the model's values. For this the logarithms
/// of masses and lengths have a prior with standard deviation one half.
PossibleValues possible_values(const Eigen::MatrixXd& N, const Eigen::VectorXd& b,
                               const Parameters& parameters, const robot::Model& model);

}  // namespace tachless::identify
