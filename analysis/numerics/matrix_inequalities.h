#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

/// Linear matrix inequalities, and an interior-point search for a large concave objective in them.
namespace tachless::numerics {

/// The inequality F(x) > 0 of symmetric matrices, F affine in x:
///
///   F(x) = constant + sum over terms of x[variable] factor (u v' + v u') / 2,
///
/// u and v the columns `left` and `right` of `vectors`. Products of vectors in place of matrices
/// make the derivatives cheap.
struct MatrixInequality {
  struct Term {
    Eigen::Index variable = 0, left = 0, right = 0;
    double factor = 1;
  };
  Eigen::MatrixXd constant;
  Eigen::MatrixXd vectors;
  std::vector<Term> terms;
  Eigen::VectorXd size;  ///< typical sizes of F's diagonal, > 0

  [[nodiscard]] Eigen::MatrixXd at(const Eigen::VectorXd& x) const;
};

/// A concave function at a point.
struct Concave {
  double value = 0;
  Eigen::VectorXd gradient;
  Eigen::VectorXd curvature;  ///< diagonal of minus the second derivative, >= 0
};
using Objective = std::function<Concave(const Eigen::VectorXd&)>;

/// Returns an x that satisfies all inequalities, from any start. Returns nothing when the search
/// finds none.
std::optional<Eigen::VectorXd> feasible_point(const std::vector<MatrixInequality>& inequalities,
                                              const Eigen::VectorXd& start);

/// Returns an x near the largest objective within the inequalities, by Newton's method with a
/// logarithmic barrier. Precondition: `start` satisfies all inequalities.
/// @param gap how far below the largest objective the result may be
Eigen::VectorXd interior_maximum(const std::vector<MatrixInequality>& inequalities,
                                 const Objective& objective, const Eigen::VectorXd& start,
                                 double gap);

}  // namespace tachless::numerics
