#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <tuple>
#include <utility>

#include "base/parallel.h"
#include "lyapunov/examined_weights.h"
#include "numerics/linear_programme.h"

// Rate and sqrt(2 level) are the least quotient num / den over postures and states. For the rate
// the quotient is -Vdot / V at delta = 0. For the level, den is the most that |C(q, delta)| can
// take of Vdot on V = 1/2. In the weights num is affine except for the worst v_ref, and den is
// affine or convex. The set of weights above a value is therefore convex. The values of num and den
// are those of the condition's bounds, which hold for all states at once. The search keeps the
// states that were found to bind and linearises their quotients. It takes the best of a linear
// programme within a trust region.
namespace tachless::lyapunov {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// x = (eps_1, eps_2), one of each error.
Weights weights_of(const VectorXd& x) { return {x.head(x.size() / 2), x.tail(x.size() / 2)}; }
VectorXd numbers_of(const Weights& weights) {
  VectorXd x(weights.eps_1.size() + weights.eps_2.size());
  x << weights.eps_1, weights.eps_2;
  return x;
}

/// A function of the weights: constant + slope' x.
struct Affine {
  double constant = 0;
  VectorXd slope;

  [[nodiscard]] double at(const VectorXd& x) const { return constant + slope.dot(x); }
};

/// A state that binds at a posture, with what its quotient needs for any weights.
struct Cut {
  /// The quotient: the rate, or that of the level. In a search for the level, a cut of the rate is
  /// a state at which -Vdot has to be positive.
  Goal goal = Goal::rate;
  std::size_t system = 0, posture = 0;
  VectorXd state;
  Affine decrease;  ///< -Vdot at delta = 0, but for the part of an unknown v_ref
  Affine V;
  /// The worst v_ref takes |a + A x| of -Vdot. Without rows where v_ref is known.
  VectorXd a;
  MatrixXd A;
  VectorXd along;  ///< edot' C(q, delta) edot = along' delta
  /// The condition bounds |C(q, delta)| for all states at once. The bound is this many times what
  /// the state gives, at the weights of the cut.
  double bound_of_delta = 1;
};

/// @param v_ref an unknown one is v_ref d, |d| <= 1
Cut cut_of(const ErrorSystem& s, const numerics::Inertia& inertia, const VectorXd& state,
           const MatrixXd& v_ref) {
  const Index N = s.num_errors(), n = s.num_links();
  const VectorXd e = state.head(N), nu = state.segment(N, N), edot = state.tail(N);
  const VectorXd p = s.inertia(inertia.M) * edot, damped = s.kd_by_b() * nu;
  // The columns belong to the units of v_ref: C edot in `forth`, C' edot in `back`.
  MatrixXd forth(n, n), back(n, n);
  for (Index j = 0; j < n; ++j) {
    const MatrixXd& C = inertia.C[static_cast<std::size_t>(j)];
    forth.col(j) = C * edot.head(n);
    back.col(j) = C.transpose() * edot.head(n);
  }
  Cut cut;
  cut.state = state;
  cut.along = forth.transpose() * edot.head(n);
  VectorXd f = s.kp * e + s.kd * nu;
  cut.decrease.constant = damped.dot(s.a.cwiseProduct(nu));
  if (s.damping.size() > 0) {
    f += s.damping.cwiseProduct(edot);
    cut.decrease.constant += edot.dot(s.damping.cwiseProduct(edot));
  }
  if (s.kp_dot.size() > 0) {
    cut.decrease.constant -= 0.5 * (e.dot(s.kp_dot * e) + nu.dot(s.kd_dot * nu.cwiseQuotient(s.b)));
  }
  if (s.v_ref.size() > 0) {
    f.head(n) += (forth - back) * s.v_ref;
    cut.decrease.constant += cut.along.dot(s.v_ref);
  } else {
    // v_ref takes (along + (forth - back)' delta)' v_ref.
    const MatrixXd by_delta = v_ref.transpose() * (forth - back).transpose();
    cut.a = v_ref.transpose() * cut.along;
    cut.A = MatrixXd::Zero(cut.a.size(), 2 * N);
    cut.A.leftCols(n) = by_delta * e.head(n).asDiagonal();
    cut.A.middleCols(N, n) = -by_delta * nu.head(n).asDiagonal();
  }
  cut.decrease.slope.resize(2 * N);
  cut.decrease.slope << e.cwiseProduct(f) - edot.cwiseProduct(p),
      (s.b.cwiseProduct(edot) - s.a.cwiseProduct(nu)).cwiseProduct(p) - nu.cwiseProduct(f);
  cut.V.constant = 0.5 * (edot.dot(p) + e.dot(s.kp * e) + nu.dot(damped));
  cut.V.slope.resize(2 * N);
  cut.V.slope << e.cwiseProduct(p), -nu.cwiseProduct(p);
  return cut;
}

/// A value and its gradient by x.
using Value = std::pair<double, VectorXd>;

/// The parts that the cuts of a posture share.
struct AtPosture {
  std::optional<MatrixXd> Mm;  ///< as the condition bounds it for every v_ref; nothing: no number
  MatrixXd M;
  std::optional<Eigen::LLT<MatrixXd>> S;  ///< of the position errors, for the goal of the level
};

/// Returns sqrt(u' S^-1 u), u = N' along: the most of along' delta on V = 1/2, delta = N (e, nu).
Value most_of_delta(const Cut& cut, const AtPosture& at, const VectorXd& x) {
  const Index N = at.M.rows();
  const auto eps_1 = x.head(N), eps_2 = x.tail(N);
  VectorXd c = VectorXd::Zero(N);
  c.head(cut.along.size()) = cut.along;
  VectorXd u(2 * N);
  u << eps_1.cwiseProduct(c), -eps_2.cwiseProduct(c);
  const VectorXd y = at.S->solve(u);
  const VectorXd by = c + at.M * (eps_1.cwiseProduct(y.head(N)) - eps_2.cwiseProduct(y.tail(N)));
  const double most = std::sqrt(u.dot(y));
  VectorXd gradient(2 * N);
  gradient << y.head(N).cwiseProduct(by) / most, -y.tail(N).cwiseProduct(by) / most;
  return {most, std::move(gradient)};
}

/// Returns num.
/// @param Mm as in `AtPosture`
Value decrease_of(const Cut& cut, const std::optional<MatrixXd>& Mm, const VectorXd& x) {
  Value num{cut.decrease.at(x), cut.decrease.slope};
  if (cut.a.size() == 0) return num;
  const VectorXd taken = cut.a + cut.A * x;
  num.first = Mm ? cut.state.dot(*Mm * cut.state) : num.first - taken.norm();
  num.second -= cut.A.transpose() * taken.stableNormalized();
  return num;
}

/// Returns num / den.
Value quotient(const Cut& cut, const AtPosture& at, const VectorXd& x) {
  const auto [num, of_num] = decrease_of(cut, at.Mm, x);
  auto [den, of_den] =
      cut.goal == Goal::level ? most_of_delta(cut, at, x) : Value{cut.V.at(x), cut.V.slope};
  if (cut.goal == Goal::level) {
    den *= cut.bound_of_delta;
    of_den *= cut.bound_of_delta;
  }
  return {num / den, (of_num - num / den * of_den) / den};
}

// Steps are shares of each weight: a step of 1 would take a weight to 0, where its region is empty.
constexpr double first_step = 0.3, largest_step = 0.6;
// The result of the coarse postures has to agree with the fine ones to 2 %. A step has to promise
// half of it.
constexpr double fine_agrees = 1.02, least_promise = 0.01;
// A quotient changes by about the share by which the weights change: a smaller step promises less.
constexpr double smallest_step = 1e-3;
constexpr int most_steps = 60;  // a cap
// States are cuts whose value is below this share of the way from the least value of a posture to
// the median of the postures. More of them give no better steps (decision 0030).
constexpr double near_least = 0.5;
// Finite bounds for the linear programme, of a quotient in units of its present size.
constexpr double most_quotient = 1e3;

class WeightSearch {
 public:
  WeightSearch(const MatrixCondition& coarse, Goal goal)
      : on_(coarse),
        goal_(goal),
        v_ref_(coarse.B_d * (coarse.v_scale.size() > 0
                                 ? coarse.v_scale
                                 : MatrixXd::Identity(coarse.postures.model.num_joints,
                                                      coarse.postures.model.num_joints))) {}

  /// Returns the rate or sqrt(2 level) over all postures. The search makes it large.
  /// @param above where the result is not above this number, it is any number up to it
  [[nodiscard]] double merit(const VectorXd& x, double above = -infinity) const {
    return merit(ExaminedWeights(on_, weights_of(x)), above);
  }
  /// Returns a merit that is as good as any. For the level it is that of errors of 1000 rad from
  /// rest in each joint: where friction outweighs C(q, v_ref) there is no largest level.
  [[nodiscard]] double enough() const {
    if (goal_ == Goal::rate) return infinity;
    return 1000 * std::sqrt(on_.systems[0].kp.diagonal().maxCoeff());
  }

  /// Returns better weights than x, and their merit. Returns x where it has none.
  std::pair<VectorXd, double> improved(const VectorXd& x) {
    cuts_.clear();
    auto at_best = std::make_unique<ExaminedWeights>(on_, weights_of(x));
    double best = merit(*at_best), radius = first_step;
    if (!std::isfinite(best)) return {x, best};
    add_cuts(*at_best);
    for (int step = 0; step < most_steps && radius > smallest_step && best < enough(); ++step) {
      const auto [d, promised] = programme(*at_best, radius);
      if (d.size() == 0 || promised - best < least_promise * std::abs(best)) break;
      const VectorXd from = numbers_of(at_best->weights());
      auto at_next =
          std::make_unique<ExaminedWeights>(on_, weights_of(from + from.cwiseProduct(d)));
      const double found = merit(*at_next);
      add_cuts(*at_next);
      if (found > best + 0.1 * (promised - best)) {
        radius = std::min(largest_step, 1.6 * radius);
      } else {
        radius /= 2;
      }
      if (found > best) {
        at_best = std::move(at_next);
        best = found;
      }
    }
    return {numbers_of(at_best->weights()), best};
  }

 private:
  [[nodiscard]] double merit(const ExaminedWeights& examined, double above = -infinity) const {
    if (goal_ == Goal::rate) return examined.slowest(0, above).value;
    const double level = examined.level(above > 0 ? above * above / 2 : -infinity);
    return level >= 0 ? std::min(enough(), std::sqrt(2 * level)) : -infinity;
  }

  /// The states that bind at the postures near the worst. Weights that are not certified have no
  /// level; the states at which V does not fall are added then.
  void add_cuts(const ExaminedWeights& examined) {
    const std::size_t count = on_.postures.inertia.size();
    const auto states = [&](Goal goal) {
      return base::parallel_map(count * on_.systems.size(), [&](std::size_t i) {
        return examined.binding(goal, i / count, i % count);
      });
    };
    Goal goal = goal_;
    std::vector<BindingStates> all = states(goal);
    const auto none = [](const BindingStates& each) { return each.value.size() == 0; };
    if (goal == Goal::level && std::ranges::any_of(all, none)) all = states(goal = Goal::rate);
    std::vector<double> least;
    for (const BindingStates& each : all) {
      if (!none(each)) least.push_back(each.value.minCoeff());
    }
    if (least.empty()) return;
    std::ranges::sort(least);
    const double near =
        goal == goal_ ? least[0] + near_least * (least[least.size() / 2] - least[0]) : 0;
    const auto cuts = base::parallel_map(all.size(), [&](std::size_t i) {
      return cuts_at(examined, goal, all[i], near, i / count, i % count);
    });
    for (const std::vector<Cut>& each : cuts) cuts_.insert(cuts_.end(), each.begin(), each.end());
  }

  /// Returns the cuts of the states whose value is not above `near`.
  [[nodiscard]] std::vector<Cut> cuts_at(const ExaminedWeights& examined, Goal goal,
                                         const BindingStates& binding, double near,
                                         std::size_t system, std::size_t posture) const {
    const VectorXd x = numbers_of(examined.weights());
    std::vector<Cut> all;
    std::optional<AtPosture> at;
    for (Index k = 0; k < binding.value.size(); ++k) {
      const double value = binding.value[k];
      if (value > near) continue;
      Cut cut =
          cut_of(on_.systems[system], on_.postures.inertia[posture], binding.state.col(k), v_ref_);
      cut.V.constant += examined.slack_of_V(system) / 2 * cut.state.squaredNorm();
      cut.goal = goal;
      cut.system = system;
      cut.posture = posture;
      if (goal == Goal::level && value > 0) {
        if (!at) at = at_posture(examined, cut);
        cut.bound_of_delta = std::max(1.0, quotient(cut, *at, x).first / value);
      }
      all.push_back(std::move(cut));
    }
    return all;
  }

  [[nodiscard]] AtPosture at_posture(const ExaminedWeights& examined, const Cut& cut) const {
    AtPosture at;
    if (cut.a.size() > 0) at.Mm = examined.decrease(cut.system, cut.posture);
    if (goal_ == Goal::level) {
      at.M = on_.systems[cut.system].inertia(on_.postures.inertia[cut.posture].M);
      at.S = examined.position_part(cut.system, cut.posture);
    }
    return at;
  }

  /// Returns the quotients of the cuts.
  [[nodiscard]] std::vector<Value> quotients(const ExaminedWeights& examined) const {
    const VectorXd x = numbers_of(examined.weights());
    const std::size_t count = on_.postures.inertia.size();
    const auto place = [&](const Cut& cut) { return cut.system * count + cut.posture; };
    std::vector<const Cut*> first(count * on_.systems.size(), nullptr);
    for (const Cut& cut : cuts_) first[place(cut)] = &cut;
    const std::vector<AtPosture> at = base::parallel_map(first.size(), [&](std::size_t i) {
      return first[i] == nullptr ? AtPosture{} : at_posture(examined, *first[i]);
    });
    return base::parallel_map(
        cuts_.size(), [&](std::size_t i) { return quotient(cuts_[i], at[place(cuts_[i])], x); });
  }

  /// Returns the best step of the linearised quotients relative to x, and the value that it
  /// promises.
  [[nodiscard]] std::pair<VectorXd, double> programme(const ExaminedWeights& at_x, double radius) {
    const VectorXd x = numbers_of(at_x.weights());
    const Index n = x.size();
    const std::vector<Value> all = quotients(at_x);
    double least = infinity;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (cuts_[i].goal == goal_) least = std::min(least, all[i].first);
    }
    const double size = std::abs(least);
    numerics::LinearProgramme lp{VectorXd::Zero(n + 1),
                                 VectorXd::Constant(n + 1, -radius),
                                 VectorXd::Constant(n + 1, radius),
                                 {}};
    lp.cost[n] = -1;
    lp.lower[n] = -most_quotient;
    lp.upper[n] = most_quotient;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const auto& [value, gradient] = all[i];
      if (!std::isfinite(value)) continue;  // C takes nothing at this state
      const double promise = cuts_[i].goal == goal_ ? -1 : 0;
      numerics::LinearProgramme::Row row{VectorXd(n + 1), -value / size};
      row.gradient << gradient.cwiseProduct(x) / size, promise;
      lp.rows.push_back(std::move(row));
    }
    const auto optimum = numerics::solution_of_many_rows(lp);
    if (!optimum) return {};
    return {optimum->x.head(n), size * optimum->x[n]};
  }

  const MatrixCondition& on_;  ///< to which postures may be added
  Goal goal_;
  MatrixXd v_ref_;  ///< an unknown v_ref is v_ref_ d, |d| <= 1
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

/// A choice of weights with what `fine` certifies for it.
struct Examined : Certified {
  /// By the goal: sqrt(2 level) [J^1/2], or the rate of V for small errors [1/s].
  double merit = 0;
};

/// Returns nothing where the weights are not certified, and the posture that forbids them or binds
/// the result.
std::pair<std::optional<Examined>, Vector> examined(const MatrixCondition& fine, Goal goal,
                                                    const Weights& weights) {
  const ExaminedWeights at(fine, weights);
  Vector forbids;
  auto region = at.region_without_ball(&forbids);
  if (!region) return {std::nullopt, std::move(forbids)};
  numerics::Extreme binds{std::sqrt(2 * region->level), region->q};
  if (goal == Goal::rate) binds = at.slowest(0);
  return {Examined{{weights, *std::move(region)}, binds.value}, std::move(binds.q)};
}

/// Returns weights near x that the coarse condition certifies, if the search for a faster rate
/// leads to any.
std::optional<VectorXd> certified_near(const MatrixCondition& coarse, const VectorXd& x) {
  auto [found, rate] = WeightSearch(coarse, Goal::rate).improved(x);
  if (!(rate > 0)) return {};
  return std::move(found);
}

/// Improves the weights x. The posture that binds a result joins the coarse ones. Returns `best` at
/// least.
std::optional<Examined> improved(MatrixCondition& coarse, const MatrixCondition& fine, Goal goal,
                                 VectorXd x, std::optional<Examined> best) {
  constexpr int rounds = 6;  // a cap: a round adds the posture that forbids the last result
  WeightSearch search(coarse, goal);
  for (int round = 0; round < rounds; ++round) {
    auto [better, promised] = search.improved(x);
    if (std::isinf(promised)) {  // the posture that joined forbids x
      const auto allowed =
          best ? std::optional(numbers_of(best->weights)) : certified_near(coarse, x);
      std::tie(better, promised) = search.improved(allowed ? *allowed : start(coarse, search));
    }
    if (!(promised > 0)) break;  // not even the coarse postures allow any
    x = better;
    auto [found, binds] = examined(fine, goal, weights_of(x));
    const bool agrees = found && promised < fine_agrees * found->merit;
    if (found && (!best || found->merit > best->merit)) best = std::move(found);
    if (agrees || coarse.postures.kind != numerics::Postures::Kind::sampled) break;
    coarse.postures.add(binds);
  }
  return best;
}

}  // namespace

std::optional<Certified> best_weights(MatrixCondition& coarse, const MatrixCondition& fine,
                                      Goal goal, const std::optional<Weights>& from) {
  const auto from_weights = [&](const Weights& weights) {
    return improved(coarse, fine, goal, numbers_of(weights), examined(fine, goal, weights).first);
  };
  if (from) return from_weights(*from);
  const auto from_grid = [&](Goal wanted) {
    return improved(coarse, fine, wanted, start(coarse, WeightSearch(coarse, wanted)), {});
  };
  auto best = from_grid(goal);
  if (best || goal == Goal::rate) return best;
  best = from_grid(Goal::rate);  // where few weights have a level, those of a positive rate do
  return best ? from_weights(best->weights) : best;
}

}  // namespace tachless::lyapunov
