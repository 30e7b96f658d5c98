#include "linear/noise.h"

#include "linear/linear_loop.h"

namespace tachless::linear {

std::optional<Eigen::VectorXd> error_by_noise(const SampledLoop& loop, double period_s,
                                              const Eigen::VectorXd& noise) {
  const LinearLaw law = loop.law(period_s);
  const CutLoop open = cut(loop.plant, law, period_s, loop.delay);
  Eigen::MatrixXd map = open.closed();
  Eigen::MatrixXd input = open.B * law.D;
  input.middleRows(loop.plant.A.rows(), law.A.rows()) += law.B;
  input *= noise.asDiagonal();
  Eigen::MatrixXd covariance = input * input.transpose();
  // Each doubling squares the number of periods: 2^40 periods of 1 us are twelve days.
  constexpr int most_doublings = 40;
  constexpr double forgotten = 1e-12;
  for (int i = 0; i < most_doublings && map.norm() > forgotten; ++i) {
    covariance += map * covariance * map.transpose();
    map = (map * map).eval();
    if (!map.allFinite() || !covariance.allFinite()) return {};
  }
  if (map.norm() > forgotten) return {};
  return covariance.diagonal().head(loop.plant.num_joints).cwiseMax(0).cwiseSqrt();
}

}  // namespace tachless::linear
