#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "certificate/error_system.h"
#include "certificate/postures.h"

/// The full matrix condition: where the matrix Mm of error_system.h is positive definite, V
/// decreases. No norm is bounded on the way, but for the balls of v_ref and delta. Like the error
/// system it is about continuous time.
namespace tachless::certificate {

/// What the reference's velocity may be: the convex hull of `vertices`, or, when there are none,
/// the ball |v_ref| <= radius.
struct VelocitySet {
  std::vector<Eigen::VectorXd> vertices;  ///< [rad/s; m/s]
  double radius = 0;

  static VelocitySet ball(double radius) { return {{}, radius}; }
  /// A regular polygon around the disc, for two joints.
  static VelocitySet polygon(double radius, int sides);
  /// |v_ref_i| <= bound_i.
  static VelocitySet box(const Eigen::VectorXd& bound);
};

/// A region of attraction, certified.
struct Region {
  double rho = 0;             ///< Vdot < 0 where |delta| <= rho, delta = eps_1 e1 - eps_2 nu1
  double w = 0;               ///< |delta|^2 <= 2 w V
  double alpha_2 = 0;         ///< V <= alpha_2 |x|^2
  double level = 0;           ///< V <= level is invariant [J]
  double ball = 0;            ///< |x(0)| <= ball is certified; mixes rad and rad/s
  Eigen::VectorXd e_at_rest;  ///< largest |e_i(0)| when that is all there is [rad; m]
  Eigen::VectorXd edot;       ///< largest |edot_i(0)| when that is all there is [rad/s; m/s]
  /// Largest |e_i| at any time from anywhere in the level set [rad; m]: where a prismatic joint's
  /// range was sampled, the certificate holds only while this is inside of it.
  Eigen::VectorXd e_reached;
  robot::Vector q;  ///< the posture that binds rho
};

struct MatrixOptions {
  /// Of the polygon around |delta| <= rho, two joints only; 0: bounded by a sum of squares, as for
  /// every other number of joints.
  int delta_sides = 0;
  bool refine = true;  ///< local refinement of the worst sampled postures
};

/// The condition for one loop over one set of postures. Everything in Mm is affine in v_ref and
/// delta, hence positive over a polytope when it is at the vertices. Over a ball it is bounded by
/// (sum x_j A_j)^2 <= |x|^2 sum A_j^2, after a congruence; that is never worse than the polytope of
/// 2 n vertices and asks for one matrix in its place. Between the postures of a circle, the matrix
/// is within a bound of the chord (see Postures), which is subtracted everywhere.
class MatrixCondition {
 public:
  /// `postures` must outlive this.
  MatrixCondition(ErrorSystem system, const Postures& postures, VelocitySet v_ref,
                  const MatrixOptions& options = {});

  /// The largest rho and what follows; nothing when Mm or V is not positive definite at delta = 0.
  [[nodiscard]] std::optional<Region> region(const Weights& weights) const;

  /// The largest mu with Vdot <= -mu V where |delta| <= rho [1/s], and the posture that binds it;
  /// V, hence the square of the error, decays at that rate and the error at mu/2. Not positive when
  /// nothing is certified; minus infinity when V is not positive definite.
  [[nodiscard]] Postures::Least slowest(const Weights& weights, double rho) const;
  [[nodiscard]] double rate(const Weights& weights, double rho) const {
    return slowest(weights, rho).value;
  }

  /// The rho that the certified ball of this radius needs; infinite when V is not positive.
  [[nodiscard]] double rho_of_ball(const Weights& weights, double ball) const;

  /// The same condition over other postures, which must outlive the result.
  [[nodiscard]] MatrixCondition over(const Postures& postures) const;

  [[nodiscard]] const ErrorSystem& system() const { return system_; }
  [[nodiscard]] const Postures& postures() const { return *postures_; }

 private:
  struct Slack {
    Eigen::MatrixXd M;         ///< of the links' M
    Eigen::MatrixXd decrease;  ///< of Mm without delta
    Eigen::MatrixXd delta;     ///< of sym C(q, delta), |delta| = 1
  };
  struct Shape;  // of V over the postures

  [[nodiscard]] Slack slack(const Weights& weights) const;
  [[nodiscard]] std::vector<Eigen::MatrixXd> decrease_at(const Weights& weights,
                                                         const Inertia& inertia,
                                                         const Slack& slack) const;
  [[nodiscard]] double rho_at(const Weights& weights, const Inertia& inertia,
                              const Slack& slack) const;
  [[nodiscard]] double rate_at(const Weights& weights, double rho, const Inertia& inertia,
                               const Slack& slack) const;
  [[nodiscard]] std::optional<Shape> shape(const Weights& weights, const Slack& slack) const;

  ErrorSystem system_;
  const Postures* postures_;
  VelocitySet v_ref_;
  double largest_v_ref_ = 0;
  MatrixOptions options_;
};

}  // namespace tachless::certificate
