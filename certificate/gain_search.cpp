#include "certificate/gain_search.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>
#include <numbers>
#include <optional>
#include <tuple>
#include <utility>

#include "certificate/prediction.h"
#include "process/parallel.h"
#include "robot/decompositions.h"

namespace tachless::certificate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using process::parallel_map;
using Row = LinearProgramme::Row;

constexpr int num_frequencies = 80, num_instants = 96;
constexpr double lowest_rad_per_s = 1;
constexpr double settled = 0.01;
// How long the errors are looked at, as part of T, and how much log |e| has to fall in another T: a
// slow pole of an amplitude just below 1 % does not pass.
constexpr double window = 3, fall = 1;
constexpr double price_of_margin = 60;
constexpr double margin_kept = 0.003;  // of it for what is between the frequencies
constexpr double near_margin = 0.3;    // rows of eigenvalues within it
constexpr double near_largest = 1.5;   // rows of errors within exp(-1.5) of the largest
constexpr double next_time = 0.85;     // of the settling time reached
constexpr double first_step = 0.3, largest_step = 0.8, smallest_step = 2e-3;
constexpr double least_promise = 0.02;  // of s: about 0.4 % of the settling time
constexpr double near_best = 0.97;      // T that near the settling time reached is not tried

/// The law at the frequencies of a grid and at these besides.
std::vector<FeedbackAt> on_grid(const Feedback& feedback, double period_s, std::vector<double> w) {
  const double highest = 0.999 * std::numbers::pi / period_s;
  for (int k = 0; k < num_frequencies; ++k) {
    w.push_back(lowest_rad_per_s * std::pow(highest / lowest_rad_per_s,
                                            static_cast<double>(k) / (num_frequencies - 1)));
  }
  std::ranges::sort(w);
  return parallel_map(w.size(),
                      [&](std::size_t k) { return at_frequency(feedback, w[k], period_s); });
}

/// Of poles that are little damped: the modulus may have a minimum there that is narrower than a
/// grid's steps [rad/s].
std::vector<double> resonances(const RestLoop& loop, const LinearLaw& law) {
  std::vector<double> w;
  for (const std::complex<double>& z : robot::eigenvalues(loop.closed(law))) {
    if (z.imag() > 0 && std::abs(std::log(std::abs(z))) < 0.3 * std::arg(z)) {
      w.push_back(std::arg(z) / loop.period_s());
    }
  }
  return w;
}

double required_fall(const Errors& errors, Index instant, double T) {
  return fall * (errors.time_s[static_cast<std::size_t>(instant)] / T - 1);
}

/// The gains as the programme sees them at one point.
class Point {
 public:
  Point(const GainProblem& problem, const VectorXd& theta) : problem_(&problem), theta_(theta) {
    make_feedback(false);
    modulus_ = parallel_map(problem.loops.size(), [&](std::size_t i) {
      return problem.loops[i].modulus(grid(i), problem.margin + near_margin);
    });
  }
  /// Before rows are asked for.
  void differentiate() { make_feedback(true); }

  [[nodiscard]] const VectorXd& theta() const { return theta_; }
  [[nodiscard]] const Feedback& feedback(std::size_t loop) const {
    return feedback_[problem_->same_everywhere ? 0 : loop];
  }
  [[nodiscard]] Index num_joints() const { return feedback_[0].law.D.rows(); }
  [[nodiscard]] double least_modulus(std::size_t loop) const {
    return *std::ranges::min_element(modulus_[loop]);
  }
  [[nodiscard]] std::pair<double, std::size_t> least_modulus() const {
    std::pair<double, std::size_t> least{infinity, 0};
    for (std::size_t i = 0; i < modulus_.size(); ++i)
      least = std::min(least, {least_modulus(i), i});
    return least;
  }
  /// What margins and counts lack; at most 0: nothing.
  [[nodiscard]] double lack() const {
    const double of_margin = problem_->margin + margin_kept - least_modulus().first;
    const VectorXd gain = own_gain(feedback_[0].law);
    return std::max(
        {0.0, of_margin, (gain.array() / problem_->most_gain.array()).log().maxCoeff()});
  }
  [[nodiscard]] bool stable() const {
    const auto radius = parallel_map(problem_->loops.size(), [&](std::size_t i) {
      return spectral_radius(problem_->loops[i].closed(feedback(i).law));
    });
    return *std::ranges::max_element(radius) < 1;
  }

  /// Log of the largest error in the window of T, of each loop.
  [[nodiscard]] VectorXd log_errors(double T) const {
    const auto each = parallel_map(problem_->num_settling, [&](std::size_t i) {
      const Errors seen = errors(problem_->loops[i], feedback(i).law, T, window * T, num_instants);
      double largest = -infinity;
      for (Index k = 0; k < seen.error.rows(); ++k) {
        const double log_error = std::log(seen.error.row(k).cwiseAbs().maxCoeff());
        if (!(log_error < infinity)) return infinity;
        largest = std::max(largest, log_error + required_fall(seen, k, T));
      }
      return largest;
    });
    return Eigen::Map<const VectorXd>(each.data(), std::ssize(each));
  }
  /// When the errors are last above 1 %, up to `end_s`.
  [[nodiscard]] double settling_s(double end_s) const {
    const auto each = parallel_map(problem_->num_settling, [&](std::size_t i) {
      const Errors all = errors(problem_->loops[i], feedback(i).law, 0, end_s, 1500);
      double last = 0;
      for (Index k = 0; k < all.error.rows(); ++k) {
        if (all.error.row(k).cwiseAbs().maxCoeff() > settled) {
          last = all.time_s[static_cast<std::size_t>(k)];
        }
      }
      return last;
    });
    return *std::ranges::max_element(each);
  }

  // Rows in (d, s, v) with v = 0 for rows without it.
  void add_margin_rows(std::size_t loop, std::vector<Row>& rows) const {
    const std::vector<double>& all = modulus_[loop];
    for (std::size_t k = 0; k < all.size(); ++k) {
      const bool lowest =
          (k == 0 || all[k] <= all[k - 1]) && (k + 1 == all.size() || all[k] <= all[k + 1]);
      if (all[k] > problem_->margin + (lowest ? near_margin : 0.03)) continue;
      problem_->loops[loop].add_rows(grid(loop)[k], feedback(loop), problem_->margin + margin_kept,
                                     near_margin, rows);
    }
  }
  void add_error_rows(std::size_t loop, double T, double largest, std::vector<Row>& rows) const;
  void add_count_rows(std::vector<Row>& rows) const;

 private:
  void make_feedback(bool derivatives) {
    const std::size_t count = problem_->same_everywhere ? 1 : problem_->loops.size();
    feedback_ = parallel_map(
        count, [&](std::size_t i) { return problem_->feedback(theta_, i, derivatives); });
    grids_ = parallel_map(problem_->resonant ? problem_->loops.size() : count, [&](std::size_t i) {
      const RestLoop& loop = problem_->loops[i];
      const Feedback& here = feedback(i);
      return on_grid(here, loop.period_s(),
                     problem_->resonant ? resonances(loop, here.law) : std::vector<double>());
    });
  }
  [[nodiscard]] const std::vector<FeedbackAt>& grid(std::size_t loop) const {
    return grids_[grids_.size() == 1 ? 0 : loop];
  }

  const GainProblem* problem_;
  VectorXd theta_;
  std::vector<Feedback> feedback_;
  std::vector<std::vector<FeedbackAt>> grids_;
  std::vector<std::vector<double>> modulus_;
};

/// s - gradient' d >= log |e| at the peaks of each error that come near the largest.
void Point::add_error_rows(std::size_t loop, double T, double largest,
                           std::vector<Row>& rows) const {
  constexpr double difference = 1e-4;
  const RestLoop& at = problem_->loops[loop];
  const Feedback& here = feedback(loop);
  const auto seen = [&](const LinearLaw& law) {
    return errors(at, law, T, window * T, num_instants);
  };
  const Errors now = seen(here.law);
  const MatrixXd& error = now.error;
  const auto moved = parallel_map(static_cast<std::size_t>(theta_.size()), [&](std::size_t p) {
    LinearLaw law = here.law;
    const LinearLaw by = here.derivative(static_cast<Index>(p));
    law.A += difference * by.A;
    law.B += difference * by.B;
    law.C += difference * by.C;
    law.D += difference * by.D;
    return seen(law).error;
  });
  for (Index c = 0; c < error.cols(); ++c) {
    for (Index k = 0; k < error.rows(); ++k) {
      const double e = std::abs(error(k, c));
      const double log_error = std::log(e) + required_fall(now, k, T);
      if (log_error < largest - near_largest) continue;
      if (k > 0 && std::abs(error(k - 1, c)) > e) continue;
      if (k + 1 < error.rows() && std::abs(error(k + 1, c)) > e && k > 0) continue;
      Row row{VectorXd::Zero(theta_.size() + 2), log_error};
      for (Index p = 0; p < theta_.size(); ++p) {
        row.gradient[p] = (1 - moved[static_cast<std::size_t>(p)](k, c) / error(k, c)) / difference;
      }
      row.gradient[theta_.size()] = 1;
      rows.push_back(std::move(row));
    }
  }
}

/// -d log(gain) >= log(gain / most).
void Point::add_count_rows(std::vector<Row>& rows) const {
  const Feedback& here = feedback(0);
  const VectorXd gain = own_gain(here.law);
  constexpr double difference = 1e-5;
  for (Index j = 0; j < gain.size(); ++j) {
    Row row{VectorXd::Zero(theta_.size()), 0};
    if (std::isfinite(problem_->most_gain[j])) {
      row.least = std::log(gain[j] / problem_->most_gain[j]);
      for (Index p = 0; p < theta_.size(); ++p) {
        LinearLaw law = here.law;
        law.D += difference * here.derivative(p).D;
        row.gradient[p] = -std::log(own_gain(law)[j] / gain[j]) / difference;
      }
    }
    rows.push_back(std::move(row));
  }
}

/// A linear programme about a point, and where its rows are.
struct Linearised {
  LinearProgramme programme;
  std::vector<std::size_t> first_margin_row;  ///< of each loop, and the end
};

Linearised programme_at(const GainProblem& problem, const Point& point, double T,
                        const VectorXd& log_errors, double radius) {
  const Index n = point.theta().size();
  const auto per_loop = parallel_map(problem.loops.size(), [&](std::size_t i) {
    std::vector<Row> rows;
    point.add_margin_rows(i, rows);
    return rows;
  });
  Linearised result;
  LinearProgramme& lp = result.programme;
  const auto with_lack = [&](const Row& row) {
    Row wide{VectorXd::Zero(n + 2), row.least};
    wide.gradient.head(n) = row.gradient;
    wide.gradient[n + 1] = 1;
    lp.rows.push_back(std::move(wide));
  };
  std::vector<Row> count;
  point.add_count_rows(count);
  for (const Row& row : count) with_lack(row);
  for (const auto& rows : per_loop) {
    result.first_margin_row.push_back(lp.rows.size());
    for (const Row& row : rows) with_lack(row);
  }
  result.first_margin_row.push_back(lp.rows.size());
  const double largest = log_errors.maxCoeff();
  for (Index i = 0; i < log_errors.size(); ++i) {
    if (log_errors[i] < largest - 0.5) continue;
    point.add_error_rows(static_cast<std::size_t>(i), T, largest, lp.rows);
  }
  lp.cost = VectorXd::Zero(n + 2);
  lp.cost[n] = 1;
  lp.cost[n + 1] = price_of_margin;
  lp.lower = VectorXd::Zero(n + 2);
  lp.upper = VectorXd::Constant(n + 2, 1e30);
  lp.lower[n] = T > problem.settling_s ? -1e30 : std::log(settled);
  lp.lower.head(n) = (problem.lower - point.theta()).cwiseMin(0).cwiseMax(-radius);
  lp.upper.head(n) = (problem.upper - point.theta()).cwiseMax(0).cwiseMin(radius);
  return result;
}

}  // namespace

FoundGains judged(const GainProblem& problem, const VectorXd& theta) {
  const Point point(problem, theta);
  FoundGains found{theta};
  if (!point.stable()) return found;
  std::tie(found.modulus, found.worst) = point.least_modulus();
  double end_s = 0.1;
  do {
    end_s *= 4;
    found.settling_s = point.settling_s(end_s);
  } while (found.settling_s > 0.5 * end_s && end_s < 1e4);
  return found;
}

std::vector<double> least_moduli(const GainProblem& problem, const VectorXd& theta) {
  const Point point(problem, theta);
  return parallel_map(problem.loops.size(), [&](std::size_t i) { return point.least_modulus(i); });
}

FoundGains faster_gains(GainProblem problem, const VectorXd& start, int most_steps,
                        const std::function<void(int, const FoundGains&)>& tell) {
  const Index n = start.size();
  FoundGains best = judged(problem, start);
  double T = std::max(problem.settling_s, next_time * best.settling_s);
  std::optional<Point> at;
  at.emplace(problem, start);
  if (at->lack() >= margin_kept) best.settling_s = infinity;
  VectorXd log_errors = at->log_errors(T);
  if (best.settling_s <= problem.settling_s) problem.margin = std::min(0.95, best.modulus + 0.02);
  const auto merit = [&](const VectorXd& log_error, double lack) {
    const double least = T > problem.settling_s ? -infinity : std::log(settled);
    return std::max(least, log_error.maxCoeff()) + price_of_margin * lack;
  };
  double reached = merit(log_errors, at->lack());
  double radius = first_step;
  const auto look_from = [&](double new_T) {
    T = std::max(problem.settling_s, new_T);
    log_errors = at->log_errors(T);
    reached = merit(log_errors, at->lack());
  };
  for (int step = 0; step < most_steps; ++step) {
    at->differentiate();
    const auto optimum = solution(programme_at(problem, *at, T, log_errors, radius).programme);
    if (!optimum) break;
    const double promised = reached - (optimum->x[n] + price_of_margin * optimum->x[n + 1]);
    if (promised < least_promise || radius < smallest_step) {  // T is too short
      const double longer = std::min(std::sqrt(T * best.settling_s), 1.3 * T);
      if (longer > near_best * best.settling_s) break;
      look_from(longer);
      radius = first_step;
      continue;
    }
    Point next(problem, at->theta() + optimum->x.head(n));
    const VectorXd next_errors = next.log_errors(T);
    const double next_merit = merit(next_errors, next.lack());
    const bool better = reached - next_merit > std::max(0.0, 0.1 * promised) && next.stable();
    radius = better ? std::min(largest_step, 1.6 * radius) : radius / 2.5;
    if (!better) continue;
    at.emplace(std::move(next));
    log_errors = next_errors;
    reached = next_merit;
    if (at->lack() >= margin_kept) continue;
    const double settling_s = at->settling_s(window * T / next_time);
    const auto [modulus, worst] = at->least_modulus();
    const bool enough = settling_s <= problem.settling_s;
    if (enough ? best.settling_s <= problem.settling_s && modulus < best.modulus
               : settling_s >= best.settling_s) {
      continue;
    }
    best = {at->theta(), settling_s, modulus, worst};
    tell(step, best);
    if (log_errors.maxCoeff() > std::log(settled)) continue;
    if (enough) problem.margin = std::min(0.95, modulus + 0.02);
    look_from(next_time * settling_s);
  }
  return best;
}

std::vector<Binding> bindings(const GainProblem& problem, const FoundGains& gains) {
  const Index n = gains.theta.size();
  Point at(problem, gains.theta);
  at.differentiate();
  const Linearised linear =
      programme_at(problem, at, gains.settling_s, at.log_errors(gains.settling_s), 0.1);
  std::vector<Binding> all;
  const auto optimum = solution(linear.programme);
  if (!optimum) return all;
  // Errors that fall by 100 in the settling time: log |e| falls by log 100 for all of it.
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

}  // namespace tachless::certificate
