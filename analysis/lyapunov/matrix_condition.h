#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "lyapunov/error_system.h"
#include "numerics/postures.h"

/// The full matrix condition: V decreases where the matrix Mm of error_system.h is positive
/// definite. Only v_ref and delta are bounded by norms. The condition is about continuous time,
/// like the error system. This header also chooses the weights of V.
namespace tachless::lyapunov {

/// A region of attraction, certified.
struct Region {
  double rho = 0;    ///< Vdot < 0 where |L^-1 delta| <= rho, delta = E1 e1 - E2 nu1 [J^1/2]
  double w = 0;      ///< |L^-1 delta|^2 <= 2 w V
  double level = 0;  ///< V <= level is invariant [J]
  double ball = 0;   ///< |x(0)| <= ball is certified; mixes rad and rad/s; 0: not computed
  Eigen::VectorXd e_at_rest;  ///< largest |e_i(0)| if all other errors are 0 [rad; m]
  Eigen::VectorXd edot;       ///< largest |edot_i(0)| if all other errors are 0 [rad/s; m/s]
  /// Largest |e_i| at any time from anywhere in the level set [rad; m].
  Eigen::VectorXd e_reached;
  Eigen::VectorXd feedback;  ///< |Kp e + Kd nu|_i <= feedback_i sqrt(2 V) [N m/J^1/2]
  Vector q;                  ///< the posture that binds rho
};

/// The aim of a choice of weights: the largest level, or the fastest rate in the limit of small
/// errors. The region of the fastest rate is the whole set in which V decreases.
enum class Goal { level, rate };

/// Returns the lower triangular L for which |L^-1 delta|^2 is the least e' Kp e + nu' Kd B^-1 nu
/// with that delta. In this norm V bounds delta by the same number in all joints.
Eigen::MatrixXd delta_scale(const ErrorSystem& system, const Weights& weights);

/// The matrix condition for all postures of a set; for a scheduled law also for all its gains. Mm
/// is affine in v_ref and delta. Over a ball its variable part is bounded by (sum x_j A_j)^2 <=
/// |x|^2 sum A_j^2, after a congruence. This bound is never worse than the polytope of 2 n vertices
/// around the ball, and it is one matrix only. Between the postures of a circle, the matrix is
/// within a bound of the chord (see Postures). The condition subtracts that bound everywhere.
struct MatrixCondition {
  std::vector<ErrorSystem> systems;  ///< the first is the system of the start
  numerics::Postures postures;
  double B_d = 0;                ///< largest |R^-1 v_ref| [rad/s; m/s], R = `v_scale`
  bool refine = true;            ///< local refinement of the worst sampled postures
  Eigen::MatrixXd v_scale = {};  ///< matrix R of an ellipsoid around v_ref; empty: a ball

  /// Returns the largest rho and its region. Returns nothing when Mm or V is not positive definite
  /// at delta = 0.
  [[nodiscard]] std::optional<Region> region(const Weights& weights) const;

  /// Returns the level of that region, in a part of the time; minus infinity where `region` returns
  /// nothing.
  [[nodiscard]] double level(const Weights& weights) const;

  /// Returns the largest mu with Vdot <= -mu V where |L^-1 delta| <= rho [1/s], and the posture
  /// that binds it. V decays at the rate mu, and the error at mu/2. The rate is not positive when
  /// nothing is certified, and minus infinity when V is not positive definite.
  [[nodiscard]] numerics::Extreme slowest(const Weights& weights, double rho) const;
  [[nodiscard]] double rate(const Weights& weights, double rho) const {
    return slowest(weights, rho).value;
  }
};

/// Weights and what they certify.
struct Certified {
  Weights weights;
  Region region;
};

/// Returns weights and what `fine` certifies for them, but for the ball of the region, which a
/// search does not compare. Returns nothing when no weights are certified. The search
/// (weight_search.cpp) uses `coarse`, which may have few postures and no refinement. Sampled
/// postures of `fine` that forbid or bind a result join `coarse`.
/// @param from start of the search; without it the best point of a grid
std::optional<Certified> best_weights(MatrixCondition& coarse, const MatrixCondition& fine,
                                      Goal goal, const std::optional<Weights>& from = {});

}  // namespace tachless::lyapunov
