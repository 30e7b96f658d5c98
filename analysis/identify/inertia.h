#pragma once

#include <Eigen/Core>

#include "identify/parameters.h"
#include "robot/model.h"

/// Links that a body can have: the pseudo-inertia of each, (1/2 tr(I) 1 - I, m c; (m c)', m), is
/// U U' with U upper triangular and a positive diagonal, whatever its ten numbers (C. Rucker,
/// P. Wensing, Smooth parameterization of rigid-body inertia, IEEE Robotics and Automation Letters
/// 7(2), 2022).
namespace tachless::identify {

/// The values with the least x'N x / 2 - b'x: no rotor, friction or payload below zero, every link
/// possible. What torques do not determine of links stays near the model's: the logarithms of
/// masses and lengths have a prior of a standard deviation of one half.
Eigen::VectorXd possible_values(const Eigen::MatrixXd& N, const Eigen::VectorXd& b,
                                const Parameters& parameters, const robot::Model& model);

}  // namespace tachless::identify
