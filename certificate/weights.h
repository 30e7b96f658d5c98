#pragma once

#include <optional>
#include <vector>

#include "certificate/matrix_condition.h"

/// The choice of the weights of V: largest ball, fastest rate, and what lies between.
namespace tachless::certificate {

/// Weights and what they certify.
struct Certified {
  Weights weights;
  Region region;
  double rate = 0;  ///< of V in the limit of small errors, mu [1/s]; the error decays at mu/2
};

// Each searches on `coarse`, which may have few postures and no refinement, and answers with what
// `fine` certifies at the weights found.

/// One weight, eps_1 = eps_2 = eps: the largest ball. Nothing when no eps is certified.
std::optional<Certified> largest_ball_one_weight(const MatrixCondition& coarse,
                                                 const MatrixCondition& fine);

/// Two weights: the largest ball.
std::optional<Certified> largest_ball(const MatrixCondition& coarse, const MatrixCondition& fine);

/// Two weights: the fastest rate in the limit of small errors; its region is where V decreases at
/// all.
std::optional<Certified> fastest_rate(const MatrixCondition& coarse, const MatrixCondition& fine);

/// The fastest rate that is certified in the whole of a ball.
struct TradeOff {
  double ball = 0;
  Weights weights;
  double rate = 0;  ///< [1/s], within the ball
};

/// Trade-off at these parts of the largest ball, from fastest weights to the largest ball's.
std::vector<TradeOff> trade_off(const MatrixCondition& coarse, const MatrixCondition& fine,
                                const Certified& fastest, const Certified& largest,
                                const std::vector<double>& parts);

}  // namespace tachless::certificate
