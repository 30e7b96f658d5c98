#pragma once

#include <Eigen/Core>
#include <functional>

#include "certificate/postures.h"
#include "robot/model.h"

/// The constants of a robot that the conditions of stability are made of. They know no gains.
namespace tachless::certificate {

/// An extreme over the postures.
struct Extreme {
  double value = 0;  ///< the best that was found, locally refined
  robot::Vector q;   ///< where [rad; m]
  /// For a two-joint arm's M and C: what no posture exceeds (or, of a minimum, falls below).
  /// Otherwise `value`.
  double bound = 0;
  bool proved = false;  ///< whether `bound` is one
};

/// Norms are Euclidean, of matrices the spectral one; sup and inf are over the postures and, where
/// there is an x, over |x| = 1.
struct RobotConstants {
  Extreme lambda_min_M, lambda_max_M;  ///< eigenvalues of M [kg m2]
  Extreme k_c;                         ///< sup |C(q,x)|, the paper's property P2 [kg m2]
  Extreme k_s;                         ///< sup |C(q,x)' - C(q,x)| [kg m2]
  Extreme k_y;                         ///< sup |sym C(q,x)| [kg m2]
  Extreme sup_g;                       ///< sup |g(q)| [N m]
  Extreme k_g;                         ///< sup |dg/dq| [N m/rad]
};

RobotConstants robot_constants(const robot::Model& model, const Postures& postures);

/// dg/dq, symmetric [N m/rad].
Eigen::MatrixXd gravity_gradient(const robot::Model& model, const robot::Vector& q);

double spectral_norm(const Eigen::MatrixXd& A);
double smallest_eigenvalue(const Eigen::MatrixXd& symmetric);
double largest_eigenvalue(const Eigen::MatrixXd& symmetric);

/// The largest f over the postures: the best `starts` of `samples` spread ones, each refined
/// locally within `in_range`.
Extreme largest(const robot::Model& model, const std::function<double(const robot::Vector&)>& f,
                int samples, int starts = 6);

}  // namespace tachless::certificate
