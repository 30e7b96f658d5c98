#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "identify/least_squares.h"
#include "identify/recording.h"

/// Tests of the model. If the model is right, its residuals are noise.
namespace tachless::identify {

/// Difference between one joint's residuals and noise.
struct Misfit {
  double correlation = 0;  ///< of the residual with itself a little later; white noise has 0
  bool found = false;      ///< the residual is too correlated and too large to be noise
  bool tested = true;      ///< there are enough rows for the correlation
  /// Coulomb friction of slow motion minus Coulomb friction of fast motion, if both were recorded
  /// and differ [N m; N]; otherwise 0.
  double slow_friction = 0;
};

/// Returns whether the model is wrong at a joint.
inline bool is_misfit(const Misfit& misfit) { return misfit.found || misfit.slow_friction != 0; }

/// Tests the torques that `values` leave unexplained in a table, in rows that are not slow, 50 ms
/// apart. No arm of 120 with a right model had a correlation above 0.2. A residual below 0.2 % of
/// the joint's peak is not called a misfit.
/// @param regressions one of each recording; the largest correlation counts
std::vector<Misfit> torque_misfits(const std::vector<Regression>& regressions,
                                   const Parameters& parameters, const Eigen::VectorXd& values);

/// Tests the positions that a simulated loop leaves unexplained, one tick apart. A residual that
/// the encoder's counts and noise explain is not called a misfit.
/// @param residual measured minus simulated positions, a row per tick
std::vector<Misfit> position_misfits(const Recording& recording, const Eigen::MatrixXd& residual);

/// Returns the worse of two tests of the same joints.
std::vector<Misfit> worse(std::vector<Misfit> one, const std::vector<Misfit>& other);

/// The answer of recordings without a known controller.
struct TableAnswer : LeastSquares {
  std::vector<Misfit> misfits;
};

/// Returns the rows that least squares uses of each joint: the fast ones, or of a joint with
/// further terms of friction those of motion one way. In fast rows alone a rise is like Coulomb
/// friction. All rows are used of a joint with a rise that only rows near reversals tell from it.
std::vector<RowUse> rows_of(const Parameters& parameters, Eigen::Index joints);

/// Identifies from torques alone. The rows of `rows_of` give the answer. A misfit at any joint
/// means that the friction of the arm differs from the model. A joint with too few rows for the
/// test may have one too. All rows of the joints without further terms then count, and the
/// difference between the two answers widens the intervals.
TableAnswer table_answer(const std::vector<Regression>& regressions, const Parameters& parameters,
                         const robot::Model& model);

}  // namespace tachless::identify
