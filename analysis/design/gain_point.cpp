#include "design/gain_point.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <iterator>

#include "base/parallel.h"
#include "certify/prediction.h"
#include "numerics/decompositions.h"

namespace tachless::design {

namespace {

using base::parallel_map;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Row = numerics::LinearProgramme::Row;

// Instants from T to `window` T: every 2^k-th tick, T / 48 to T / 24 apart.
constexpr int num_instants = 96;
// Instants by which the settling time is judged: at most 1 % of it apart, since it is more than an
// eighth of the examined interval.
constexpr int num_instants_judged = 1500;
// Fall of log |e| that is required during another T. It excludes a slow pole with an amplitude just
// below 1 %.
constexpr double fall = 1;
// Distance above the least modulus within which the frequencies of a descent lie. Moduli at other
// frequencies would have to fall as far before they count.
constexpr double near_least = 0.15;
constexpr double near_largest = 1.5;  // keeps rows of errors within exp(-1.5) of the largest
// Loops whose largest error is within exp(-0.5) of the largest of all get rows of errors.
constexpr double near_slowest = 0.5;
// Decay over angle of a lightly damped mode: a damping ratio below 0.29. Its peak of 1.8 and more
// may lie between the kept frequencies, which are a tenth apart at 1 kHz.
constexpr double lightly_damped = 0.3;
// Distance above the margin within which a frequency beside a minimum gets rows, too: ten times the
// margin kept for dips. There the minimum may be after the step.
constexpr double near_minimum = 0.03;

/// Evaluates the law at the kept frequencies.
std::vector<FeedbackAt> on_grid(const linear::Feedback& feedback, double period_s) {
  return linear::at_frequencies(feedback, linear::kept_frequencies(period_s), period_s);
}

/// Adds the law at the frequencies `w` to a grid.
std::vector<FeedbackAt> with(std::vector<FeedbackAt> grid, const linear::Feedback& feedback,
                             double period_s, const std::vector<double>& w) {
  std::ranges::move(linear::at_frequencies(feedback, w, period_s), std::back_inserter(grid));
  std::ranges::stable_sort(grid, {}, &FeedbackAt::w);
  return grid;
}

/// Returns the frequencies of lightly damped poles [rad/s]. The modulus may have a minimum there
/// that is narrower than the grid's steps.
std::vector<double> resonances(const linear::RestLoop& loop, const linear::LinearLaw& law) {
  std::vector<double> w;
  for (const std::complex<double>& z : numerics::eigenvalues(loop.closed(law))) {
    if (z.imag() > 0 && std::abs(std::log(std::abs(z))) < lightly_damped * std::arg(z)) {
      w.push_back(std::arg(z) / loop.period_s());
    }
  }
  return w;
}

double required_fall(const linear::Errors& errors, Index instant, double T) {
  return fall * (errors.time_s[static_cast<std::size_t>(instant)] / T - 1);
}

}  // namespace

LeastModulus::LeastModulus(const GainProblem& problem, const VectorXd& theta)
    : problem_(&problem), theta_(theta) {
  if (!problem.same_everywhere || problem.resonant) return;
  grid_ = on_grid(problem.feedback(theta, problem.rests[0], false), problem.loops[0].period_s());
}

double LeastModulus::at(const linear::RestLoop& loop, const messages::ReferencePoint& rest,
                        double enough, const std::vector<double>& among) const {
  if (!grid_.empty() && among.empty()) return loop.least_modulus(grid_, enough);
  return loop.least_modulus(grid(loop, rest, among), enough);
}

std::vector<FeedbackAt> LeastModulus::grid(const linear::RestLoop& loop,
                                           const messages::ReferencePoint& rest,
                                           const std::vector<double>& among) const {
  if (!grid_.empty() && among.empty()) return grid_;
  if (!grid_.empty()) {
    std::vector<FeedbackAt> some;
    std::ranges::copy_if(grid_, std::back_inserter(some), [&](const FeedbackAt& each) {
      return std::ranges::binary_search(among, each.w);
    });
    return some;
  }
  const linear::Feedback here = problem_->feedback(theta_, rest, false);
  if (!among.empty()) return linear::at_frequencies(here, among, loop.period_s());
  const double h = loop.period_s();
  if (!problem_->resonant) return on_grid(here, h);
  return with(on_grid(here, h), here, h, resonances(loop, here.law));
}

std::vector<double> LeastModulus::lowest(const linear::RestLoop& loop,
                                         const messages::ReferencePoint& rest) const {
  const std::vector<FeedbackAt> all = grid(loop, rest, {});
  const std::vector<double> modulus = loop.modulus(all, problem_->margin + near_margin);
  const double most = *std::ranges::min_element(modulus) + near_least;
  std::vector<double> w;
  for (std::size_t k = 0; k < all.size(); ++k) {
    if (modulus[k] <= most) w.push_back(all[k].w);
  }
  return w;
}

GainPoint::GainPoint(const GainProblem& problem, const VectorXd& theta)
    : problem_(&problem), theta_(theta) {
  make_feedback(false);
}

void GainPoint::look_at_margins() {
  if (grids_.empty()) make_grids();
  modulus_ = parallel_map(problem_->loops.size(), [&](std::size_t i) {
    return problem_->loops[i].modulus(grid(i), problem_->margin + near_margin);
  });
}

void GainPoint::differentiate() {
  make_feedback(true);
  // Derivatives at a frequency serve all loops, or are computed for the rows that need them.
  if (feedback_.size() == 1 && !problem_->resonant) make_grids();
}

void GainPoint::make_feedback(bool derivatives) {
  const std::size_t count = problem_->same_everywhere ? 1 : problem_->loops.size();
  feedback_ = parallel_map(count, [&](std::size_t i) {
    return problem_->feedback(theta_, problem_->rests[i], derivatives);
  });
}

void GainPoint::make_grids() {
  const double h = problem_->loops[0].period_s();
  const auto kept =
      parallel_map(feedback_.size(), [&](std::size_t i) { return on_grid(feedback_[i], h); });
  if (!problem_->resonant) {
    grids_ = kept;
    return;
  }
  grids_ = parallel_map(problem_->loops.size(), [&](std::size_t i) {
    const linear::Feedback& here = feedback(i);
    return with(kept[kept.size() == 1 ? 0 : i], here, h, resonances(problem_->loops[i], here.law));
  });
}

double GainPoint::least_modulus(std::size_t loop) const {
  return *std::ranges::min_element(modulus_[loop]) / problem_->share[loop];
}

double GainPoint::least_modulus() const {
  double least = infinity;
  for (std::size_t i = 0; i < modulus_.size(); ++i) least = std::min(least, least_modulus(i));
  return least;
}

double GainPoint::lack() const { return lack_with(least_modulus()); }

double GainPoint::lack_with(double least) const {
  const double of_margin = problem_->margin + margin_kept - least;
  return std::max({0.0, of_margin, count_lack().lack});
}

double GainPoint::lack_alone() {
  // A modulus above this number lacks nothing.
  const double enough = 1.001 * (problem_->margin + margin_kept);
  if (grids_.empty()) make_grids();
  const auto least = parallel_map(problem_->loops.size(), [&](std::size_t i) {
    const double share = problem_->share[i];
    return problem_->loops[i].least_modulus(grid(i), share * enough) / share;
  });
  return lack_with(*std::ranges::min_element(least));
}

Lack GainPoint::count_lack() const {
  Index joint = 0;
  const double most = (largest_gain().array() / problem_->most_gain.array()).log().maxCoeff(&joint);
  return {most, static_cast<std::size_t>(joint)};
}

VectorXd GainPoint::largest_gain(double by, Index variable) const {
  VectorXd largest = VectorXd::Zero(num_joints());
  for (std::size_t i = 0; i < feedback_.size(); ++i) {
    if (problem_->share[i] < 1) continue;
    linear::LinearLaw law = feedback_[i].law;
    if (by != 0) law.D += by * feedback_[i].derivative(variable).D;
    largest = largest.cwiseMax(certify::own_gain(law));
  }
  return largest;
}

bool GainPoint::stable() const {
  const auto radius = parallel_map(problem_->loops.size(), [&](std::size_t i) {
    return linear::spectral_radius(problem_->loops[i].closed(feedback(i).law));
  });
  return *std::ranges::max_element(radius) < 1;
}

VectorXd GainPoint::log_errors(double T) const {
  const auto each = parallel_map(problem_->settling.size(), [&](std::size_t judged) {
    const std::size_t i = problem_->settling[judged];
    const linear::Errors seen =
        errors(problem_->loops[i], feedback(i).law, T, window * T, num_instants);
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

std::vector<double> GainPoint::settling_s(double end_s,
                                          const std::vector<std::size_t>& loops) const {
  return parallel_map(loops.size(), [&](std::size_t k) {
    const std::size_t i = loops[k];
    return errors(problem_->loops[i], feedback(i).law, 0, end_s, num_instants_judged)
        .last_unsettled_s()
        .maxCoeff();
  });
}

void GainPoint::add_margin_rows(std::size_t loop, std::vector<Row>& rows) const {
  const std::vector<double>& all = modulus_[loop];
  for (std::size_t k = 0; k < all.size(); ++k) {
    const bool lowest =
        (k == 0 || all[k] <= all[k - 1]) && (k + 1 == all.size() || all[k] <= all[k + 1]);
    const double least = problem_->share[loop] * (problem_->margin + margin_kept);
    if (all[k] > least + (lowest ? near_margin : near_minimum)) continue;
    const linear::RestLoop& at = problem_->loops[loop];
    const linear::Feedback& law = feedback(loop);
    const FeedbackAt& here = grid(loop)[k];
    const bool complete = here.by_kind.size() == law.by_kind.size();
    at.add_rows(complete ? here : linear::at_frequency(law, here.w, at.period_s()), law, least,
                near_margin, rows);
  }
}

/// Adds rows s - gradient' d >= log |e| at the peaks of each error that come near the largest.
void GainPoint::add_error_rows(std::size_t loop, double T, double largest,
                               std::vector<Row>& rows) const {
  constexpr double difference = 1e-4;
  const linear::RestLoop& at = problem_->loops[loop];
  const linear::Feedback& here = feedback(loop);
  const auto seen = [&](const linear::LinearLaw& law) {
    return errors(at, law, T, window * T, num_instants);
  };
  const linear::Errors now = seen(here.law);
  const MatrixXd& error = now.error;
  const auto moved = parallel_map(static_cast<std::size_t>(theta_.size()), [&](std::size_t p) {
    linear::LinearLaw law = here.law;
    const linear::LinearLaw by = here.derivative(static_cast<Index>(p));
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

/// Adds rows -d log(gain) >= log(gain / most).
void GainPoint::add_count_rows(std::vector<Row>& rows) const {
  constexpr double difference = 1e-5;
  const VectorXd gain = largest_gain();
  MatrixXd slope(gain.size(), theta_.size());
  for (Index p = 0; p < theta_.size(); ++p) {
    slope.col(p) = (largest_gain(difference, p).array() / gain.array()).log() / difference;
  }
  for (Index j = 0; j < gain.size(); ++j) {
    Row row{VectorXd::Zero(theta_.size()), 0};
    if (std::isfinite(problem_->most_gain[j])) {
      row.least = std::log(gain[j] / problem_->most_gain[j]);
      row.gradient = -slope.row(j);
    }
    rows.push_back(std::move(row));
  }
}

Linearised programme_at(const GainProblem& problem, const GainPoint& point, double T,
                        const VectorXd& log_errors, double radius) {
  const Index n = point.theta().size();
  const auto per_loop = parallel_map(problem.loops.size(), [&](std::size_t i) {
    std::vector<Row> rows;
    point.add_margin_rows(i, rows);
    return rows;
  });
  Linearised result;
  numerics::LinearProgramme& lp = result.programme;
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
    if (log_errors[i] < largest - near_slowest) continue;
    point.add_error_rows(problem.settling[static_cast<std::size_t>(i)], T, largest, lp.rows);
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

}  // namespace tachless::design
