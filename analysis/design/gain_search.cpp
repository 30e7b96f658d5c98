#include "design/gain_search.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "design/gain_point.h"

namespace tachless::design {

namespace {

using base::parallel_map;
using Eigen::Index;
using Eigen::VectorXd;

// Share of the settling time reached, at which the errors are to be below 1 % next. Poles go with
// the root of the stiffness: gains larger by `first_step`, 35 %, make them 16 % faster.
constexpr double next_time = 0.85;
// Steps of the gains' logarithms: 35 % at first, at most a factor of 2.2, within which derivatives
// still foretell the errors. A step below 0.2 % changes the settling time by less than that.
constexpr double first_step = 0.3, largest_step = 0.8, smallest_step = 2e-3;
constexpr double least_promise = 0.02;  // least decrease of s, about 0.4 % of the settling time
// Factors of the step after a good one and a bad one. If it grew by as much as it shrinks, the size
// that was refused would be tried again after one good step.
constexpr double grows = 1.6, shrinks = 2.5;
constexpr double kept_promise =
    0.1;  // least share of the promised decrease that a step has to keep
// Steps after which postures are added. To look for them takes the moduli of some hundred loops; a
// step takes those of some ten.
constexpr int steps_between_loops = 5;
// Share of the settling time reached, beyond which no T is tried, and the largest factor by which T
// grows at once.
constexpr double near_best = 0.97, longer_time = 1.3;
// Steps by which the margin is raised once the settling time is short enough. |1 + L| is 1 where L
// vanishes: no loop has a larger margin.
constexpr double more_margin = 0.02, most_margin = 0.95;

/// Returns the times at which the errors of these loops last exceed 1 %. Extends the examined
/// interval until it is at least twice as long as these times.
std::vector<double> settling_times(const GainPoint& point, const std::vector<std::size_t>& loops) {
  // A time of more than an eighth of the interval is judged to 1 % of it (`num_instants_judged`).
  // A loop that needs hours is as useless as one that does not settle.
  constexpr double first_s = 0.4, grows = 4, longest_s = 1e4;
  double end_s = first_s;
  std::vector<double> times = point.settling_s(end_s, loops);
  while (std::ranges::max(times) > 0.5 * end_s && end_s < longest_s) {
    end_s *= grows;
    times = point.settling_s(end_s, loops);
  }
  return times;
}

}  // namespace

FoundGains judged(const GainProblem& problem, const VectorXd& theta) {
  GainPoint point(problem, theta);
  FoundGains found{theta};
  if (!point.stable()) return found;
  point.look_at_margins();
  found.modulus = point.least_modulus();
  found.settling_s = std::ranges::max(settling_times(point, problem.settling));
  return found;
}

double least_modulus(const GainProblem& problem, const VectorXd& theta) {
  GainPoint point(problem, theta);
  if (!point.stable()) return 0;
  point.look_at_margins();
  return point.least_modulus();
}

std::vector<double> least_moduli(const GainProblem& problem, const VectorXd& theta, double above) {
  const LeastModulus least(problem, theta);
  return parallel_map(problem.loops.size(), [&](std::size_t i) {
    return least.at(problem.loops[i], problem.rests[i], problem.margin + above) / problem.share[i];
  });
}

std::vector<double> settling_times(const GainProblem& problem, const VectorXd& theta) {
  const GainPoint point(problem, theta);
  std::vector<std::size_t> all(problem.loops.size());
  std::iota(all.begin(), all.end(), 0);
  return settling_times(point, all);
}

namespace {

/// Moves from given gains to faster ones, step by step.
class Climb {
 public:
  Climb(GainProblem& problem, const FoundGains& start)
      : problem_(problem), margin_(problem.margin), T_(next_time * start.settling_s) {
    begin_at(start.theta);
  }
  ~Climb() { problem_.margin = margin_; }

  /// Restarts from `theta` with the present problem.
  void begin_at(const VectorXd& theta) {
    problem_.margin = margin_;
    best_ = judged(problem_, theta);
    at_.emplace(problem_, theta);
    at_->look_at_margins();
    if (at_->lack() >= margin_kept) best_.settling_s = infinity;
    if (best_.settling_s <= problem_.settling_s) {
      problem_.margin = std::min(most_margin, best_.modulus + more_margin);
    }
    look_from(std::min(T_, next_time * best_.settling_s));
    radius_ = first_step;
  }

  [[nodiscard]] const FoundGains& best() const { return best_; }
  [[nodiscard]] const VectorXd& theta() const { return at_->theta(); }

  /// Takes one step.
  /// @param accepted set to whether the step led to other gains
  /// @return whether the search can go on
  bool step(bool& accepted) {
    accepted = false;
    at_->differentiate();
    const auto optimum =
        numerics::solution(programme_at(problem_, *at_, T_, log_errors_, radius_).programme);
    if (!optimum) return false;
    const double promised =
        reached_ - (optimum->x[last() - 1] + price_of_margin * optimum->x[last()]);
    if (promised < least_promise || radius_ < smallest_step) {  // T is too short
      const double longer = std::min(std::sqrt(T_ * best_.settling_s), longer_time * T_);
      if (longer > near_best * best_.settling_s) return false;
      look_from(longer);
      radius_ = first_step;
      return true;
    }
    GainPoint next(problem_, at_->theta() + optimum->x.head(last() - 1));
    const VectorXd next_errors = next.log_errors(T_);
    const double enough = reached_ - std::max(0.0, kept_promise * promised);
    double next_merit = merit(next_errors, 0);
    if (next_merit < enough) next_merit = merit(next_errors, next.lack_alone());
    accepted = next_merit < enough && next.stable();
    radius_ = accepted ? std::min(largest_step, grows * radius_) : radius_ / shrinks;
    if (!accepted) return true;
    next.look_at_margins();
    at_.emplace(std::move(next));
    log_errors_ = next_errors;
    reached_ = next_merit;
    if (at_->lack() < margin_kept) note();
    return true;
  }

 private:
  [[nodiscard]] Index last() const { return at_->theta().size() + 1; }
  [[nodiscard]] double merit(const VectorXd& log_errors, double lack) const {
    const double least = T_ > problem_.settling_s ? -infinity : std::log(settled);
    return std::max(least, log_errors.maxCoeff()) + price_of_margin * lack;
  }
  void look_from(double T) {
    T_ = std::max(problem_.settling_s, T);
    log_errors_ = at_->log_errors(T_);
    reached_ = merit(log_errors_, at_->lack());
  }
  /// Records the present gains, which keep the margin, if they are better than the best so far.
  void note() {
    const double settling_s =
        std::ranges::max(at_->settling_s(window * T_ / next_time, problem_.settling));
    const double modulus = at_->least_modulus();
    const bool enough = settling_s <= problem_.settling_s;
    if (enough ? best_.settling_s <= problem_.settling_s && modulus < best_.modulus
               : settling_s >= best_.settling_s) {
      return;
    }
    best_ = {at_->theta(), settling_s, modulus};
    if (log_errors_.maxCoeff() > std::log(settled)) return;
    if (enough) problem_.margin = std::min(most_margin, modulus + more_margin);
    look_from(next_time * settling_s);
  }

  GainProblem& problem_;
  double margin_, T_;
  FoundGains best_;
  double radius_ = first_step, reached_ = 0;
  std::optional<GainPoint> at_;
  VectorXd log_errors_;
};

}  // namespace

FoundGains faster_gains(GainProblem& problem, const VectorXd& start, int most_steps,
                        const AddLoops& add,
                        const std::function<void(int, const FoundGains&)>& tell) {
  const FoundGains begin = judged(problem, start);
  if (!(begin.modulus > 0)) return begin;  // unstable loops have no settling time
  Climb climb(problem, begin);
  int accepted = 0;
  for (int step = 0; step < most_steps; ++step) {
    bool moved = false;
    const bool goes_on = climb.step(moved);
    accepted += moved ? 1 : 0;
    tell(step, climb.best());
    if (step + 1 == most_steps) break;  // after the last step, no loops are added
    if (goes_on && (!moved || accepted % steps_between_loops != 0)) continue;
    const VectorXd here =
        goes_on || !std::isfinite(climb.best().settling_s) ? climb.theta() : climb.best().theta;
    if (add(problem, here)) {
      climb.begin_at(here);
    } else if (!goes_on) {
      break;
    }
  }
  return climb.best();
}

std::vector<Binding> bindings(const GainProblem& problem, const FoundGains& gains) {
  const Index n = gains.theta.size();
  GainPoint at(problem, gains.theta);
  at.look_at_margins();
  at.differentiate();
  const Linearised linear =
      programme_at(problem, at, gains.settling_s, at.log_errors(gains.settling_s), 0.1);
  std::vector<Binding> all;
  const auto optimum = numerics::solution(linear.programme);
  if (!optimum) return all;
  // The errors fall by 100 in the settling time, so log 100 corresponds to the whole of it.
  const auto add = [&](Binding::Kind kind, std::size_t which, double gained) {
    const double share = gained / std::log(1 / settled);
    if (share > 1e-3) all.push_back({kind, which, share});
  };
  VectorXd reduced = linear.programme.cost;
  for (Index i = 0; i < optimum->price.size(); ++i) {
    reduced -= optimum->price[i] * linear.programme.rows[static_cast<std::size_t>(i)].gradient;
  }
  for (Index j = 0; j < at.num_joints(); ++j) {
    add(Binding::Kind::count, static_cast<std::size_t>(j), optimum->price[j] * std::log(1.1));
  }
  for (std::size_t i = 0; i < problem.loops.size(); ++i) {
    const auto first = static_cast<Index>(linear.first_margin_row[i]);
    const auto end = static_cast<Index>(linear.first_margin_row[i + 1]);
    add(Binding::Kind::margin, i,
        optimum->price.segment(first, end - first).sum() * 0.1 * problem.margin);
  }
  for (Index p = 0; p < n; ++p) {
    const bool at_bound = optimum->x[p] + gains.theta[p] > problem.upper[p] - 1e-9 ||
                          optimum->x[p] + gains.theta[p] < problem.lower[p] + 1e-9;
    if (at_bound) {
      add(Binding::Kind::bound, static_cast<std::size_t>(p), std::abs(reduced[p]) * std::log(1.1));
    }
  }
  std::ranges::sort(all, std::greater(), &Binding::settling_share);
  return all;
}

}  // namespace tachless::design
