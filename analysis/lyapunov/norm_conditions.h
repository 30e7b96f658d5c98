#pragma once

#include <Eigen/Core>

#include "lyapunov/error_system.h"
#include "numerics/postures.h"

/// Norms of a robot's dynamics, and the stability conditions that Loria and Ortega (1995) print in
/// terms of these norms. The conditions have one weight eps = eps_1 = eps_2 and hold in continuous
/// time. They are very conservative, and their proof has a gap (docs/paper.md). The condition of
/// matrix_condition.h has neither fault.
namespace tachless::lyapunov {

/// Constants of a robot. Norms are Euclidean, and spectral for matrices. Each sup and inf is over
/// the postures and, where there is an x, over |x| = 1. The values come from sampled postures, and
/// the best of these are refined locally. The values are therefore no bounds. They do not depend on
/// gains.
struct RobotConstants {
  numerics::Extreme lambda_min_M, lambda_max_M;  ///< eigenvalues of M [kg m2]
  numerics::Extreme k_c;                         ///< sup |C(q,x)|, the paper's property P2 [kg m2]
  numerics::Extreme k_g;                         ///< sup |dg/dq| [N m/rad]
};

/// Returns the constants of a robot.
RobotConstants robot_constants(const robot::Model& model);

struct Interval {
  double low = 0, high = 0;
};

/// The paper's conditions on eps: (25) < eps < (19), (20), (23), (24), (27), and (7). They have to
/// hold for some beta_1 + beta_2 + beta_3 = 1 and gamma_1 + gamma_2 = 1, all > 0. Eq. (27) prints
/// gamma_2 = 1/2. The bounds are given for gamma_1 = beta_1 = beta_3 = 1: multiply an upper bound
/// by its share, and divide the lower bound by it.
struct PrintedConditions {
  double eq7 = 0;  ///< b_i > eq7 / beta_2; for flexible joints this is eq. 12
  double eq19 = 0, eq20 = 0;
  double eq23 = 0;  ///< times gamma_1
  double eq24 = 0;  ///< times gamma_1 beta_1
  double eq25 = 0;  ///< divided by beta_3
  double eq27 = 0;  ///< for gamma_2 = 1/2
  bool feasible = false;
  Interval epsilon;  ///< values of eps for which some beta and gamma exist
  // The best certified ball over eps, beta and gamma.
  double c1 = 0;    ///< eq. 8
  double eq26 = 0;  ///< R = (beta_2 lambda(B) lambda(M) - Lambda(M)) / (2 k_c) [rad; rad/s]
};

/// Returns the conditions of an error system.
/// @param B_d upper bound of |v_ref| [rad/s]
PrintedConditions printed_conditions(const ErrorSystem& system, const RobotConstants& constants,
                                     double B_d);

}  // namespace tachless::lyapunov
