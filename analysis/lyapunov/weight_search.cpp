#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "base/parallel.h"
#include "linear/linear_loop.h"
#include "lyapunov/examined_weights.h"
#include "numerics/linear_programme.h"

// Rate and sqrt(2 level) are the least quotient num / den over postures and states. For the rate
// the quotient is -Vdot / V at delta = 0. For the level, den is the most that |C(q, delta)| can
// take of Vdot on V = 1/2. In the weights num is affine except for the worst v_ref, and den is
// affine or convex. The set of weights above a value is therefore convex. The search keeps the
// states that were found to bind and linearises their quotients. It takes the best of a linear
// programme within a trust region.
namespace tachless::lyapunov {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// x = (eps_1, eps_2), one of each error.
Weights weights_of(const VectorXd& x) { return {x.head(x.size() / 2), x.tail(x.size() / 2)}; }

/// A state that binds at a posture: its quotient for any weights.
struct Cut {
  const ErrorSystem* system;
  numerics::Inertia inertia;
  VectorXd state;

  /// num / den and its gradient by x.
  [[nodiscard]] std::pair<double, VectorXd> quotient(Goal goal, const MatrixXd& v_ref,
                                                     const VectorXd& x) const;
};

/// @param v_ref the worst is v_ref d, |d| <= 1
std::pair<double, VectorXd> Cut::quotient(Goal goal, const MatrixXd& v_ref,
                                          const VectorXd& x) const {
  const ErrorSystem& s = *system;
  const Index N = s.num_errors(), n = s.num_links();
  const VectorXd e = state.head(N), nu = state.segment(N, N), edot = state.tail(N);
  const auto eps_1 = x.head(N), eps_2 = x.tail(N);
  const MatrixXd M = s.inertia(inertia.M), damper = s.kd_by_b();
  const VectorXd p = M * edot;
  const VectorXd delta = (eps_1.cwiseProduct(e) - eps_2.cwiseProduct(nu)).head(n);
  // The columns belong to the units of v_ref: C edot in `forth`, C' edot in `back`. `of_v` is the
  // gradient of num by v_ref.
  MatrixXd forth(n, n), back(n, n);
  for (Index j = 0; j < n; ++j) {
    const MatrixXd& C = inertia.C[static_cast<std::size_t>(j)];
    forth.col(j) = C * edot.head(n);
    back.col(j) = C.transpose() * edot.head(n);
  }
  const VectorXd along = forth.transpose() * edot.head(n);
  const VectorXd of_v = along + (forth - back).transpose() * delta;
  const VectorXd v = s.v_ref.size() > 0
                         ? s.v_ref
                         : VectorXd(-v_ref * (v_ref.transpose() * of_v).stableNormalized());
  VectorXd f = s.kp * e + s.kd * nu;
  f.head(n) += (forth - back) * v;
  double num = nu.dot(damper * s.a.cwiseProduct(nu)) + along.dot(v);
  if (s.damping.size() > 0) {
    f += s.damping.cwiseProduct(edot);
    num += edot.dot(s.damping.cwiseProduct(edot));
  }
  if (s.kp_dot.size() > 0) {
    num -= 0.5 * (e.dot(s.kp_dot * e) + nu.dot(s.kd_dot * nu.cwiseQuotient(s.b)));
  }
  VectorXd of_num(2 * N), of_den(2 * N);
  of_num << e.cwiseProduct(f) - edot.cwiseProduct(p),
      (s.b.cwiseProduct(edot) - s.a.cwiseProduct(nu)).cwiseProduct(p) - nu.cwiseProduct(f);
  num += of_num.dot(x);
  double den = 0;
  if (goal == Goal::rate) {
    of_den << e.cwiseProduct(p), -nu.cwiseProduct(p);
    den = 0.5 * (edot.dot(p) + e.dot(s.kp * e) + nu.dot(damper * nu)) + of_den.dot(x);
  } else {  // sqrt(u' S^-1 u), u = (E1 c, -E2 c), c' delta = edot' C(q, delta) edot
    VectorXd c = VectorXd::Zero(N);
    c.head(n) = along;
    const MatrixXd G = delta_of(s, weights_of(x)).transpose();
    const VectorXd u = G * c;
    const VectorXd y = (stiffness_of(s) - G * M * G.transpose()).llt().solve(u);
    const VectorXd by = c + M * (G.transpose() * y);
    den = std::sqrt(u.dot(y));
    of_den << y.head(N).cwiseProduct(by) / den, -y.tail(N).cwiseProduct(by) / den;
  }
  return {num / den, (of_num - num / den * of_den) / den};
}

// Steps are shares of each weight: a step of 1 would take a weight to 0, where its region is empty.
constexpr double first_step = 0.3, largest_step = 0.6;
// The least gain that a step has to promise: a tenth of the 2 % to which the result of the coarse
// postures has to agree with the fine ones.
constexpr double least_promise = 2e-3, fine_agrees = 1.02;
// A quotient changes by about the share by which the weights change: a smaller step promises less.
constexpr double smallest_step = 1e-3;
constexpr int most_steps = 60;  // a cap
// States within half of the least value are cuts, and cuts beyond six times the least are left out
// of a linear programme. Others seldom bind after one step; if they do, the next cuts have them,
// since these are of all postures.
constexpr double near_least = 0.5, far_from_least = 5;
// Finite bounds for the linear programme, of a quotient in units of its present size.
constexpr double most_quotient = 1e3;

class WeightSearch {
 public:
  WeightSearch(const MatrixCondition& coarse, Goal goal) : on_(coarse), goal_(goal) {}

  /// Returns the rate or sqrt(2 level) over all postures. The search makes it large.
  /// @param above where the result is not above this number, it is any number up to it
  [[nodiscard]] double merit(const VectorXd& x, double above = -infinity) const {
    return merit(ExaminedWeights(on_, weights_of(x)), above);
  }
  /// Returns errors of 1000 rad from rest in each joint as sqrt(2 level). Where friction outweighs
  /// C(q, v_ref) there is no largest level, and weights that reach this level are as good as any.
  [[nodiscard]] double enough() const {
    return 1000 * std::sqrt(on_.systems[0].kp.diagonal().maxCoeff());
  }

  /// Returns better weights than x, and their merit.
  std::pair<VectorXd, double> improved(VectorXd x) {
    cuts_.clear();
    const ExaminedWeights at_x(on_, weights_of(x));
    double best = merit(at_x), radius = first_step;
    add_cuts(at_x);
    for (int step = 0; step < most_steps && std::isfinite(best) && radius > smallest_step &&
                       !(goal_ == Goal::level && best >= enough());
         ++step) {
      const auto [d, promised] = programme(x, radius);
      if (d.size() == 0 || promised - best < least_promise * std::abs(best)) break;
      const VectorXd next = x + x.cwiseProduct(d);
      const ExaminedWeights at_next(on_, weights_of(next));
      const double found = merit(at_next);
      if (std::isfinite(found)) add_cuts(at_next);
      if (found > best + 0.1 * (promised - best)) {
        radius = std::min(largest_step, 1.6 * radius);
      } else {
        radius /= 2;
      }
      if (found > best) {
        x = next;
        best = found;
      }
    }
    return {x, best};
  }

 private:
  [[nodiscard]] double merit(const ExaminedWeights& examined, double above = -infinity) const {
    if (goal_ == Goal::rate) return examined.slowest(0, above).value;
    const double level = examined.level(above > 0 ? above * above / 2 : -infinity);
    return level >= 0 ? std::min(enough(), std::sqrt(2 * level)) : -infinity;
  }

  /// The states that bind at the postures near the worst.
  void add_cuts(const ExaminedWeights& examined) {
    const std::size_t count = on_.postures.inertia.size();
    std::vector<MatrixXd> states(count * on_.systems.size());
    const auto value = base::parallel_map(states.size(), [&](std::size_t i) {
      return examined.at(goal_, i / count, i % count, states[i]);
    });
    const double least = *std::ranges::min_element(value);
    for (std::size_t i = 0; i < value.size(); ++i) {
      if (value[i] > least + near_least * std::abs(least)) continue;
      for (Index k = 0; k < states[i].cols(); ++k) {
        cuts_.push_back(
            {&on_.systems[i / count], on_.postures.inertia[i % count], states[i].col(k)});
      }
    }
  }

  /// Returns the best step of the linearised quotients relative to x, and the value that it
  /// promises.
  [[nodiscard]] std::pair<VectorXd, double> programme(const VectorXd& x, double radius) {
    const Index n = x.size();
    const Index links = on_.postures.model.num_joints;
    const MatrixXd v_ref =
        on_.B_d * (on_.v_scale.size() > 0 ? on_.v_scale : MatrixXd::Identity(links, links));
    const auto all = base::parallel_map(
        cuts_.size(), [&](std::size_t i) { return cuts_[i].quotient(goal_, v_ref, x); });
    double least = infinity;
    for (const auto& [value, gradient] : all) least = std::min(least, value);
    const double size = std::abs(least);
    numerics::LinearProgramme lp{VectorXd::Zero(n + 1),
                                 VectorXd::Constant(n + 1, -radius),
                                 VectorXd::Constant(n + 1, radius),
                                 {}};
    lp.cost[n] = -1;
    lp.lower[n] = -most_quotient;
    lp.upper[n] = most_quotient;
    for (const auto& [value, gradient] : all) {
      if (!(value < least + far_from_least * size)) continue;
      numerics::LinearProgramme::Row row{VectorXd(n + 1), -value / size};
      row.gradient << gradient.cwiseProduct(x) / size, -1;
      lp.rows.push_back(std::move(row));
    }
    const auto optimum = numerics::solution(lp);
    if (!optimum) return {};
    return {optimum->x.head(n), size * optimum->x[n]};
  }

  const MatrixCondition& on_;  ///< to which postures may be added
  Goal goal_;
  std::vector<Cut> cuts_;
};

/// The best point of a coarse grid of weights in fixed proportions. Mm's second block is positive
/// only for eps_2 below a_i / b_i, and its third only for eps_1 below eps_2 b_i. The grid goes from
/// half of these bounds down to 1e-6 of the first and 1e-5 of the second, in factors of three: two
/// of the largest steps of the search that begins there.
VectorXd start(const MatrixCondition& coarse, const WeightSearch& search) {
  const ErrorSystem& system = coarse.systems[0];
  const double a = system.a.minCoeff();
  VectorXd best;
  double value = -infinity;
  for (double below = 0.7; below < 14; below += 1.1) {
    for (double ratio_below = 0.7; ratio_below < 12; ratio_below += 1.1) {
      const double top = a * std::exp(-below);
      VectorXd x(2 * system.num_errors());
      x << VectorXd::Constant(system.num_errors(), top * std::exp(-ratio_below)),
          top * system.b.cwiseInverse();
      const double found = search.merit(x, value);
      if (best.size() > 0 && !(found > value)) continue;
      best = x;
      value = found;
    }
  }
  return best;
}

double merit(Goal goal, const Certified& c) {
  return goal == Goal::rate ? c.rate : std::sqrt(2 * c.region.level);
}

/// Improves the weights x. Postures that bind the result join the coarse ones. Returns `best` at
/// least.
std::optional<Certified> improved(MatrixCondition& coarse, const MatrixCondition& fine, Goal goal,
                                  VectorXd x, std::optional<Certified> best) {
  constexpr int rounds = 6;  // a cap: a round adds the posture that forbids the last result
  WeightSearch search(coarse, goal);
  for (int round = 0; round < rounds; ++round) {
    if (best && std::isinf(search.merit(x))) x << best->weights.eps_1, best->weights.eps_2;
    double promised = 0;
    std::tie(x, promised) = search.improved(x);
    const Weights weights = weights_of(x);
    const ExaminedWeights examined(fine, weights);
    const numerics::Extreme slowest = examined.slowest(0);
    const auto region = examined.region_without_ball();
    if (region) {
      Certified found{weights, *region, slowest.value};
      const double kept = merit(goal, found);
      if (!best || kept > merit(goal, *best)) best = std::move(found);
      if (promised < fine_agrees * kept) break;
    }
    if (coarse.postures.kind != numerics::Postures::Kind::sampled) break;
    coarse.postures.add(slowest.q);
    if (region) coarse.postures.add(region->q);
  }
  return best;
}

}  // namespace

std::optional<Certified> best_weights(MatrixCondition coarse, const MatrixCondition& fine,
                                      Goal goal, const std::optional<Weights>& from) {
  const auto from_weights = [&](const Weights& weights, std::optional<Certified> best) {
    VectorXd x(2 * weights.eps_1.size());
    x << weights.eps_1, weights.eps_2;
    return improved(coarse, fine, goal, x, std::move(best));
  };
  if (from) {
    const ExaminedWeights examined(fine, *from);
    const auto region = examined.region_without_ball();
    if (!region) return from_weights(*from, {});
    return from_weights(*from, Certified{*from, *region, examined.slowest(0).value});
  }
  const auto from_grid = [&](Goal wanted) {
    return improved(coarse, fine, wanted, start(coarse, WeightSearch(coarse, wanted)), {});
  };
  auto best = from_grid(goal);
  if (best || goal == Goal::rate) return best;
  best = from_grid(Goal::rate);  // where few weights have a level, those of a positive rate do
  return best ? from_weights(best->weights, best) : best;
}

}  // namespace tachless::lyapunov
