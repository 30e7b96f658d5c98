#include "certificate/weights.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "certificate/optimise.h"

namespace tachless::certificate {
namespace {

using Eigen::VectorXd;

constexpr double infinity = std::numeric_limits<double>::infinity();

/// x = (log eps_2, log(eps_1 / eps_2)).
Weights weights_of(const VectorXd& x) {
  const double eps_2 = std::exp(x[0]);
  return {x.size() > 1 ? eps_2 * std::exp(x[1]) : eps_2, eps_2};
}

VectorXd point(double log_eps_2, double log_ratio) {
  VectorXd x(2);
  x << log_eps_2, log_ratio;
  return x;
}

/// Mm's second block is positive only for eps_2 below a_i / b_i, and its third only for
/// eps_1 / eps_2 below b_i.
double log_eps_2_limit(const ErrorSystem& s) { return std::log(s.a.cwiseQuotient(s.b).minCoeff()); }
double log_ratio_limit(const ErrorSystem& s) { return std::log(s.b.minCoeff()); }

using Objective = std::function<double(const Weights&)>;  // to be minimised

/// From the best two points of a coarse grid below the limits; infinite where nothing is found.
Minimum search(const MatrixCondition& condition, const Objective& objective, bool two) {
  const auto f = [&](const VectorXd& x) { return objective(weights_of(x)); };
  std::vector<Minimum> starts;
  const double top = log_eps_2_limit(condition.system());
  for (double below = 0.7; below < 14; below += two ? 1.1 : 0.5) {
    if (!two) {
      const VectorXd x = VectorXd::Constant(1, top - below);
      starts.push_back({x, f(x)});
      continue;
    }
    const double ratio_top = log_ratio_limit(condition.system());
    for (double ratio_below = 0.7; ratio_below < 12; ratio_below += 1.1) {
      const VectorXd x = point(top - below, ratio_top - ratio_below);
      starts.push_back({x, f(x)});
    }
  }
  std::sort(starts.begin(), starts.end(),
            [](const Minimum& a, const Minimum& b) { return a.value < b.value; });
  Minimum best = starts[0];
  for (std::size_t i = 0; i < 2 && !std::isinf(starts[i].value); ++i) {
    const Minimum refined = minimise(f, starts[i].x, 0.3, 150);
    if (refined.value < best.value) best = refined;
  }
  return best;
}

/// The result at full rigour; nothing when the search found no certified weights.
std::optional<Certified> certified(const MatrixCondition& condition, const Weights& weights) {
  std::optional<Region> region = condition.region(weights);
  if (!region) return {};
  return Certified{weights, std::move(*region), condition.rate(weights, 0)};
}

std::optional<Certified> largest_ball_of(const MatrixCondition& coarse, const MatrixCondition& fine,
                                         bool two) {
  const Minimum best = search(
      coarse,
      [&](const Weights& weights) {
        const auto region = coarse.region(weights);
        return region ? -std::log(region->ball) : infinity;
      },
      two);
  if (std::isinf(best.value)) return {};
  return certified(fine, weights_of(best.x));
}

double rate_in_ball(const MatrixCondition& condition, const Weights& weights, double ball) {
  const double rho = condition.rho_of_ball(weights, ball);
  return std::isinf(rho) ? -infinity : condition.rate(weights, rho);
}

}  // namespace

std::optional<Certified> largest_ball_one_weight(const MatrixCondition& coarse,
                                                 const MatrixCondition& fine) {
  return largest_ball_of(coarse, fine, false);
}

std::optional<Certified> largest_ball(const MatrixCondition& coarse, const MatrixCondition& fine) {
  return largest_ball_of(coarse, fine, true);
}

std::optional<Certified> fastest_rate(const MatrixCondition& coarse, const MatrixCondition& fine) {
  const Minimum best = search(
      coarse, [&](const Weights& weights) { return -coarse.rate(weights, 0); }, true);
  if (!(best.value < 0)) return {};
  return certified(fine, weights_of(best.x));
}

std::vector<TradeOff> trade_off(const MatrixCondition& coarse, const MatrixCondition& fine,
                                const Certified& fastest, const Certified& largest,
                                const std::vector<double>& parts) {
  std::vector<TradeOff> result;
  const auto x_of = [](const Weights& w) {
    return point(std::log(w.eps_2), std::log(w.eps_1 / w.eps_2));
  };
  for (const double part : parts) {
    const double ball = part * largest.region.ball;
    const auto f = [&](const VectorXd& x) {
      const Weights weights = weights_of(x);
      return -rate_in_ball(coarse, weights, ball);
    };
    // Both ends and the result before: the best of them is certified at least.
    std::vector<VectorXd> starts = {x_of(fastest.weights), x_of(largest.weights)};
    if (!result.empty()) starts.push_back(x_of(result.back().weights));
    const VectorXd start =
        *std::min_element(starts.begin(), starts.end(),
                          [&](const VectorXd& a, const VectorXd& b) { return f(a) < f(b); });
    const Minimum best = minimise(f, start, 0.3, 80);
    const Weights weights = weights_of(best.x);
    result.push_back({ball, weights, rate_in_ball(fine, weights, ball)});
  }
  return result;
}

}  // namespace tachless::certificate
