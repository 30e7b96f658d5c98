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

/// What weights are searched for, to be minimised: over some postures, and of what is certified.
struct Goal {
  double (*objective)(const MatrixCondition&, const Weights&);
  double (*value)(const Certified&);
};

constexpr Goal of_ball = {[](const MatrixCondition& condition, const Weights& weights) {
                            const auto region = condition.region(weights);
                            return region ? -std::log(region->ball) : infinity;
                          },
                          [](const Certified& c) { return -std::log(c.region.ball); }};
constexpr Goal of_rate = {[](const MatrixCondition& condition, const Weights& weights) {
                            return -condition.rate(weights, 0);
                          },
                          [](const Certified& c) { return -c.rate; }};

/// Searches on the coarse postures; where the fine ones certify much less at the weights found,
/// the postures that bind there join the coarse ones, and the search goes on from those weights.
std::optional<Certified> search_certified(const MatrixCondition& coarse,
                                          const MatrixCondition& fine, const Goal& goal, bool two) {
  constexpr int rounds = 6;
  Postures postures = coarse.postures();
  const MatrixCondition condition = coarse.over(postures);
  const auto f = [&](const Weights& weights) { return goal.objective(condition, weights); };
  Minimum best = search(condition, f, two);
  std::optional<Certified> result;
  for (int round = 0; round < rounds && !std::isinf(best.value); ++round) {
    const Weights weights = weights_of(best.x);
    const Postures::Least slowest = fine.slowest(weights, 0);
    const auto region = fine.region(weights);
    if (region) {
      Certified found{weights, *region, slowest.value};
      if (!result || goal.value(found) < goal.value(*result)) result = std::move(found);
    }
    if (postures.kind() != Postures::Kind::sampled) break;
    postures.add(slowest.q);
    if (region) postures.add(region->q);
    if (f(weights) - best.value <= 1e-2 * std::abs(best.value)) break;
    // The old optimum may have no value any more: nearby, with a smaller eps_2, there is one.
    VectorXd start = best.x;
    for (int i = 0; i < 12 && std::isinf(f(weights_of(start))); ++i) start[0] -= 0.2;
    best = minimise([&](const VectorXd& x) { return f(weights_of(x)); }, start, 0.3, 80);
  }
  return result;
}

double rate_in_ball(const MatrixCondition& condition, const Weights& weights, double ball) {
  const double rho = condition.rho_of_ball(weights, ball);
  return std::isinf(rho) ? -infinity : condition.rate(weights, rho);
}

}  // namespace

std::optional<Certified> largest_ball_one_weight(const MatrixCondition& coarse,
                                                 const MatrixCondition& fine) {
  return search_certified(coarse, fine, of_ball, false);
}

std::optional<Certified> largest_ball(const MatrixCondition& coarse, const MatrixCondition& fine) {
  return search_certified(coarse, fine, of_ball, true);
}

std::optional<Certified> fastest_rate(const MatrixCondition& coarse, const MatrixCondition& fine) {
  return search_certified(coarse, fine, of_rate, true);
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
    const Minimum best = minimise(f, start, 0.3, 50);
    const Weights weights = weights_of(best.x);
    result.push_back({ball, weights, rate_in_ball(fine, weights, ball)});
  }
  return result;
}

}  // namespace tachless::certificate
