#pragma once

#include <Eigen/Cholesky>
#include <optional>
#include <vector>

#include "lyapunov/matrix_condition.h"

namespace tachless::lyapunov {

/// The parts of a condition that are the same at all postures, for one system and one choice of
/// weights; and what several answers need at a posture.
struct ConstantParts;

/// States that bind at a posture, and the rate or rho of each. The least value is that of the
/// posture.
struct BindingStates {
  Eigen::VectorXd value;  ///< rate [1/s] or rho [J^1/2]
  Eigen::MatrixXd state;  ///< a column for each, in (e, nu, edot)
};

/// The answers of a condition for one choice of weights. Mm is computed once at each posture of the
/// condition's set, for the region and for the rate. The answers are those of the functions of
/// MatrixCondition with the same names.
class ExaminedWeights {
 public:
  /// @param condition has to outlive the object, without change
  ExaminedWeights(const MatrixCondition& condition, const Weights& weights);
  ExaminedWeights(const ExaminedWeights&) = delete;
  ExaminedWeights& operator=(const ExaminedWeights&) = delete;
  ~ExaminedWeights();

  [[nodiscard]] std::optional<Region> region() const;
  /// Returns the region with `Region::ball` 0: a search does not compare it.
  /// @param forbids receives the posture at which there is no region, where there is none
  [[nodiscard]] std::optional<Region> region_without_ball(Vector* forbids = nullptr) const;
  /// Returns `Region::ball` of a level [J].
  [[nodiscard]] double ball(double level) const;
  /// @param above a level [J] that the result has to exceed; if it does not, it is minus infinity
  [[nodiscard]] double level(double above = -infinity) const;
  /// @param above a rate [1/s] that the result has to exceed; if it does not, it is any rate that
  ///   is not above, and its posture is of no use
  [[nodiscard]] numerics::Extreme slowest(double rho, double above = -infinity) const;
  /// Returns the states that bind the rate in the limit of small errors, or rho, of a system at a
  /// posture of the set. There are none where V is not positive definite, and none for rho where Mm
  /// at delta = 0 is not.
  [[nodiscard]] BindingStates binding(Goal goal, std::size_t system, std::size_t posture) const;
  /// Returns Mm at delta = 0 of a system at a posture of the set, less what the condition subtracts
  /// for every v_ref. Returns nothing where the condition does not hold at rest.
  [[nodiscard]] std::optional<Eigen::MatrixXd> decrease(std::size_t system,
                                                        std::size_t posture) const;
  /// Returns the Cholesky factor of S = diag(Kp, Kd B^-1) - N' M N of a system at a posture of the
  /// set, delta = N (e, nu).
  [[nodiscard]] Eigen::LLT<Eigen::MatrixXd> position_part(std::size_t system,
                                                          std::size_t posture) const;
  /// Returns what the condition adds to the diagonal of the matrix of 2 V between two postures.
  [[nodiscard]] double slack_of_V(std::size_t system) const;
  [[nodiscard]] const Weights& weights() const { return weights_; }

 private:
  const MatrixCondition& condition_;
  Weights weights_;
  std::vector<ConstantParts> constants_;  ///< one of each system
};

}  // namespace tachless::lyapunov
