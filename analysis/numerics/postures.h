#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "robot/model.h"

/// The postures over which a condition on M and C is checked, with both at each, and extremes over
/// them. What is between them is bounded where the robot allows it, and only there is a result
/// "proved".
namespace tachless::numerics {

/// Local minimisation without derivatives (NLopt's Subplex) from `start` with first steps `step`.
/// `f` may return +infinity where it has no value. Not global: the caller chooses the starts.
struct Minimum {
  Eigen::VectorXd x;
  double value = 0;
};
Minimum minimise(const std::function<double(const Eigen::VectorXd&)>& f,
                 const Eigen::VectorXd& start, double step, int max_evaluations);

/// M(q) and C(q, e_j), so that C(q, x) = sum_j x_j C[j]; or one harmonic of them.
struct Inertia {
  Eigen::MatrixXd M;               ///< [kg m2]
  std::vector<Eigen::MatrixXd> C;  ///< [kg m2]
};

Inertia inertia_at(const robot::Model& model, const Vector& q);

/// An extreme over the postures.
struct Extreme {
  double value = 0;  ///< the best that was found
  Vector q;          ///< where [rad; m]
};

struct PostureOptions {
  int circle_points = 360;  ///< postures of a two-joint arm
  /// Whether what is between the points of the circle is bounded. Without it the result is one of
  /// sampling.
  bool bound_between = true;
  int samples = 2048;  ///< postures of other robots
  /// Of other robots only those within `reach` [rad; m] of one of these; empty: all.
  std::vector<Vector> centres = {};
  Vector reach = {};
};

/// A set of postures that stands for all of them. Gravity is not in it: the law cancels it.
///
/// One joint that all bodies hang on: one posture, since M does not depend on it. Two revolute
/// joints of which all bodies hang on the first: M and C are functions of q2 alone, trigonometric
/// polynomials of low degree; they are taken on a grid, and between two grid points they are
/// within step^2/8 sup|d2/dq2^2| of the chord, which their harmonics bound. Otherwise a
/// low-discrepancy sequence over the full circle of each revolute joint (errors are not wrapped
/// and the level set does not end at a joint limit) and over the range of each prismatic one; or
/// over the boxes around `centres`.
struct Postures {
  enum class Kind { point, circle, sampled };
  struct Harmonic {
    double order = 0;  ///< cos(order q2), sin(order q2)
    Inertia cosine, sine;
  };

  explicit Postures(robot::Model of, const PostureOptions& options = {});

  /// Whether it is one of those that the set stands for.
  [[nodiscard]] bool contains(const Vector& posture) const;

  /// One more posture, for a search to respect; nothing is proved of it.
  void add(const Vector& posture);

  /// The smallest f over the set. Of a sampled set the three smallest are refined locally when
  /// `refine` is set.
  [[nodiscard]] Extreme smallest(const std::function<double(const Inertia&)>& f, bool refine) const;

  robot::Model model;
  std::vector<Vector> centres;
  Vector reach;
  Kind kind = Kind::sampled;
  bool proved = false;      ///< whether the postures in between are bounded
  double chord_factor = 0;  ///< step^2 / 8
  std::vector<Vector> q;
  std::vector<Inertia> inertia;  ///< at each of q
  /// The harmonics of M and C but the constant; empty unless the kind is `circle` and proved.
  std::vector<Harmonic> harmonics;
};

/// Number `k` of a sequence that fills the postures evenly (Kronecker's, by powers of the
/// generalised golden ratio): revolute joints over the full circle, prismatic ones over their
/// range, 2 m where it is not bounded.
Vector spread_posture(const robot::Model& model, int k);

/// The largest f over the first `samples` of that sequence, of which the best six are refined
/// locally within the same range. Revolute joints in [-pi, pi].
Extreme largest(const robot::Model& model, const std::function<double(const Vector&)>& f,
                int samples);

}  // namespace tachless::numerics
