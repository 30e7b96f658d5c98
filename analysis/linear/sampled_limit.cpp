#include "linear/sampled_limit.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <map>
#include <numbers>
#include <utility>
#include <vector>

#include "linear/gain_rows.h"
#include "numerics/decompositions.h"
#include "numerics/golden_section.h"
#include "numerics/sign_change.h"

namespace tachless::linear {
namespace {

using Eigen::Index;
using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXcd;

/// The loop's frequency response L, from a torque that is added to the feedback terms to the
/// feedback terms that come back, negated. 1 + L is singular where the loop is on the edge.
class Response {
 public:
  Response(const CutLoop& open, double period_s) : period_s_(period_s) {
    MatrixXd closed = open.closed();
    const Eigen::VectorXd scale = balance(closed), inverse = scale.cwiseInverse();
    poles_ = numerics::eigenvalues(closed);
    // The decomposition is that of the balanced loop. Otherwise the rounding of a law's large
    // states would hide its small ones.
    const numerics::Schur A =
        numerics::real_schur(inverse.asDiagonal() * open.A * scale.asDiagonal());
    peaks_ = numerics::eigenvalues(A.T);
    response_ = {A, inverse.asDiagonal() * open.B, open.C * scale.asDiagonal()};
  }

  /// Returns the spectral radius of the closed loop.
  [[nodiscard]] double radius() const { return poles_.cwiseAbs().maxCoeff(); }
  [[nodiscard]] const VectorXcd& eigenvalues(double w) const {
    Value& here = at(w);
    if (here.eigenvalues.size() == 0) here.eigenvalues = numerics::eigenvalues(here.L);
    return here.eigenvalues;
  }
  [[nodiscard]] double modulus(double w) const {
    return (eigenvalues(w).array() + 1).abs().minCoeff();
  }
  [[nodiscard]] double smallest_singular_value(double w) const {
    MatrixXcd one_plus = at(w).L;
    one_plus.diagonal().array() += 1;
    return numerics::smallest_singular_value(one_plus);
  }
  [[nodiscard]] std::vector<double> frequencies(bool with_peaks = false) const {
    return linear::frequencies(poles_, period_s_, 500, with_peaks ? peaks_ : VectorXcd());
  }

 private:
  struct Value {
    MatrixXcd L;
    VectorXcd eigenvalues;  ///< empty: not asked for yet
  };
  /// Returns L at w. Three searches look at the same grid, so that each value is computed once.
  [[nodiscard]] Value& at(double w) const {
    const auto [found, is_new] = known_.try_emplace(w);
    if (is_new) found->second.L = -response_.at(std::polar(1.0, w * period_s_));
    return found->second;
  }

  double period_s_;
  FrequencyResponse response_;
  VectorXcd poles_, peaks_;  ///< of the closed loop; poles of L
  mutable std::map<double, Value> known_;
};

/// Returns states of the loop (plant, memory, torques under way) that begin in `displaced`. The
/// law's memory is as a run begins there. No torque is under way.
MatrixXd starts(const SampledLoop& loop, const LinearLaw& law) {
  const Index n = loop.plant.num_joints, plant = loop.plant.A.rows(), memory = law.A.rows();
  MatrixXd state = displaced(loop.plant, plant + memory + loop.delay * n);
  state.middleRows(plant, memory) =
      first_memory(law, measured_rows(law.measured, n, plant) * state.topRows(plant));
  return state;
}

/// Returns when the errors after each joint is displaced are settled [s]. Instants are several
/// periods apart where settling takes long.
Eigen::VectorXd settling_times(const MatrixXd& map, const MatrixXd& starts, double period_s,
                               double decay_per_s) {
  constexpr int most_instants = 2000;
  // Several slowest modes together need longer than one; more than threefold none has been seen.
  // Each turn of the loop examines less than a quarter of the time before, down to single periods.
  double longest_s = -3 * std::log(settled) / decay_per_s;
  while (true) {
    double step_s = period_s;
    while (longest_s > most_instants * step_s) step_s *= 2;
    const Eigen::VectorXd settled_s =
        errors(map, starts, period_s, step_s, longest_s, most_instants).last_unsettled_s();
    // The slowest mode may be a small part of the error: then once more, closer.
    const double last_s = settled_s.maxCoeff() + step_s;
    if (step_s == period_s || last_s > longest_s / 4) return settled_s;
    longest_s = last_s;
  }
}

/// Finds phase and delay margin: the lag that rotates an eigenvalue of L to -1 where it crosses the
/// unit circle. Each eigenvalue is followed by itself, so that one which leaves the circle does not
/// hide another which enters it. Also finds bounds of the gains at which one is at -1.
class Crossings {
 public:
  explicit Crossings(const Response& response) : response_(response) {}

  void find(const std::vector<double>& w, Margins& margins) {
    margins.phase_deg = 180;
    margins.delay_s = infinity;
    VectorXcd before = response_.eigenvalues(w[0]);
    add_gains_at_end(before);
    for (std::size_t k = 1; k < w.size(); ++k) {
      before = between(w[k - 1], before, w[k], most_halvings, margins);
    }
    add_gains_at_end(before);
  }
  /// No gain between these, around 1, puts an eigenvalue of the gain times L at -1, as far as the
  /// frequencies show.
  [[nodiscard]] double gain_above() const { return gain_above_; }
  [[nodiscard]] double gain_below() const { return gain_below_; }

 private:
  /// Adds the gain that moves `real` to -1, if there is one.
  void add_gain(double real) {
    constexpr double by_chords = 1.2;  // a value between two frequencies is interpolated
    const double gain = -1 / real;
    if (!(gain > 0)) return;
    if (gain > 1 / by_chords) gain_above_ = std::min(gain_above_, gain / by_chords);
    if (gain < by_chords) gain_below_ = std::max(gain_below_, gain * by_chords);
  }
  /// At z = 1 and z = -1 eigenvalues are real, or pairs.
  void add_gains_at_end(const VectorXcd& eigenvalues) {
    constexpr double nearly_real = 0.3;  // the lowest frequency is not 0
    for (const std::complex<double>& each : eigenvalues) {
      if (std::abs(each.imag()) < nearly_real * std::abs(each.real())) add_gain(each.real());
    }
  }
  /// Halvings of an interval in which an eigenvalue may cross the circle and come back.
  static constexpr int most_halvings = 4;

  /// Returns the eigenvalues at w, each in the place of the nearest one of `near`.
  [[nodiscard]] VectorXcd followed(double w, const VectorXcd& near) const {
    VectorXcd rest = response_.eigenvalues(w), result = near;
    for (Index i = 0; i < near.size(); ++i) {
      Index nearest = i;
      for (Index j = i + 1; j < rest.size(); ++j) {
        if (std::abs(rest[j] - near[i]) < std::abs(rest[nearest] - near[i])) nearest = j;
      }
      result[i] = rest[nearest];
      std::swap(rest[nearest], rest[i]);
    }
    return result;
  }

  /// Adds the crossings from `low`, where the eigenvalues are `before`, to `high`. Returns those at
  /// `high`.
  VectorXcd between(double low, const VectorXcd& before, double high, int halvings,
                    Margins& margins) {
    const VectorXcd now = followed(high, before);
    const auto may_return = [&](Index i) {
      const double from_circle =
          std::min(std::abs(std::abs(before[i]) - 1), std::abs(std::abs(now[i]) - 1));
      return from_circle < std::abs(now[i] - before[i]);
    };
    bool halve = false;
    for (Index i = 0; i < now.size(); ++i) halve = halve || may_return(i);
    if (halve && halvings > 0) {
      const double middle = (low + high) / 2;
      const VectorXcd at_middle = between(low, before, middle, halvings - 1, margins);
      return between(middle, at_middle, high, halvings - 1, margins);
    }
    for (Index i = 0; i < now.size(); ++i) {
      const bool outside = std::abs(before[i]) > 1;
      if (outside != (std::abs(now[i]) > 1)) add(low, before, high, i, margins);
      const std::complex<double> change = now[i] - before[i];
      if ((before[i].imag() > 0) == (now[i].imag() > 0)) continue;
      add_gain(before[i].real() - before[i].imag() * change.real() / change.imag());
    }
    return now;
  }

  /// Adds the crossing of eigenvalue `i` from `low`, where the eigenvalues are `before`, to `high`.
  void add(double low, const VectorXcd& before, double high, Index i, Margins& margins) const {
    constexpr double accuracy = 1e-12;  // of the interval
    const double sign = std::abs(before[i]) > 1 ? -1 : 1;
    // Eigenvalues keep their places if they are followed from the nearest known frequency below.
    std::map<double, VectorXcd> known = {{low, before}};
    const auto at = [&](double w) -> const VectorXcd& {
      if (const auto found = known.find(w); found != known.end()) return found->second;
      const VectorXcd& below = std::prev(known.lower_bound(w))->second;
      return known.emplace(w, followed(w, below)).first->second;
    };
    const auto beyond = [&](double w) { return sign * (std::abs(at(w)[i]) - 1); };
    const double w = numerics::last_negative(beyond, {low, beyond(low)}, {high, beyond(high)},
                                             accuracy * (high - low));
    // Eigenvalues that change places from one frequency to the next do not cross the circle.
    constexpr double off_circle = 1e-3;
    if (std::abs(beyond(w)) > off_circle) return;
    double lag = std::arg(-at(w)[i]);
    margins.phase_deg = std::min(margins.phase_deg, std::abs(lag) * 180 / std::numbers::pi);
    if (lag < 0) lag += 2 * std::numbers::pi;
    margins.delay_s = std::min(margins.delay_s, lag / w);
  }

  const Response& response_;
  double gain_above_ = infinity, gain_below_ = 0;
};

/// Returns the gain nearest to 1 that makes a stable loop unstable, in steps of `factor` up to
/// `most`, and refined to 1e-7. Returns nothing where none was found.
/// @param excess spectral radius less 1, by the gain
/// @param here excess at the gain 1
/// @param near gains from 1 to this one are taken as stable if the last step before it is
template <class Excess>
std::optional<double> unstable_gain(const Excess& excess, numerics::ValueAt here, double factor,
                                    double most, double near) {
  constexpr double accuracy = 1e-7;
  const auto is_before = [&](double gain, double end) {
    return factor > 1 ? gain < end : gain > end;
  };
  double gain = 1;
  while (is_before(gain, most) && is_before(gain * factor, near)) gain *= factor;
  if (const double there = gain == 1 ? here.value : excess(gain); there < 0) here = {gain, there};
  while (is_before(here.x, most)) {
    const numerics::ValueAt next{here.x * factor, excess(here.x * factor)};
    if (!(next.value < 0)) return numerics::last_negative(excess, here, next, accuracy * here.x);
    here = next;
  }
  return {};
}

/// A stable period and an unstable one above it.
struct Limit {
  double stable, unstable;
};

/// Returns the first limit above `low`, which is stable, in steps of 2 % up to `high`. Nothing:
/// none was found. A maximum of the radius is looked at too, if it may be 1: if 1 is within ten
/// times what the maximum stands out by.
template <class F>
std::optional<Limit> narrow_window(const F& radius, double low, double high) {
  constexpr double step = 1.02, beyond = 10;
  double h0 = low, h1 = low, r0 = radius(low), r1 = r0;
  for (double h = step * low; h < high; h *= step) {
    const double r = radius(h);
    if (r >= 1) return Limit{h1, h};
    if (r1 >= r0 && r1 >= r && 1 - r1 < beyond * (r1 - std::min(r0, r))) {
      const double top = numerics::largest_between(radius, h0, h);
      if (radius(top) >= 1) return Limit{h0, top};
    }
    h0 = std::exchange(h1, h);
    r0 = std::exchange(r1, r);
  }
  return {};
}

}  // namespace

CutLoop cut(const SampledLoop& loop, double period_s) {
  return cut(loop.plant, loop.law(period_s), period_s, loop.delay);
}

double radius_at(const SampledLoop& loop, double period_s) {
  return spectral_radius(cut(loop, period_s).closed());
}

std::optional<double> largest_stable_period(const SampledLoop& loop, double from_s) {
  constexpr double ratio = 1.1;
  constexpr int halvings = 17;  // to a millionth
  const auto radius = [&](double h) { return radius_at(loop, h); };
  const auto stable = [&](double h) { return radius_at(loop, h) < 1; };
  double inside = from_s;
  while (!stable(inside)) {
    inside /= ratio;
    if (inside < shortest_s) return {};
  }
  const double first = inside;
  std::optional<Limit> limit;
  while (inside < longest_s && !limit) {
    const double next = std::min(inside * ratio, longest_s);
    if (!stable(next))
      limit = Limit{inside, next};
    else
      inside = next;
  }
  if (const auto narrow = narrow_window(radius, first, inside)) limit = narrow;
  return limit ? edge(limit->stable, limit->unstable, halvings, stable) : inside;
}

Modes modes(const SampledLoop& loop, double period_s) {
  const LinearLaw law = loop.law(period_s);
  const MatrixXd map = cut(loop.plant, law, period_s, loop.delay).closed();
  const VectorXcd z = balanced_eigenvalues(map);
  Modes result;
  result.radius = z.cwiseAbs().maxCoeff();
  result.stable = result.radius < 1;
  double decay = infinity;
  for (const std::complex<double>& value : z) {
    if (std::abs(value) < 1e-12) continue;  // decayed after some periods
    const std::complex<double> s = std::log(value) / period_s;
    decay = std::min(decay, -s.real());
    const double damping = -s.real() / std::abs(s);
    if (s.imag() != 0 && damping < result.least_damping) {
      result.least_damping = damping;
      result.least_damped_hz = std::abs(s.imag()) / (2 * std::numbers::pi);
    }
  }
  result.decay_per_s = decay;
  result.settling_s = result.settling_mean_s = infinity;
  if (result.stable) {
    const Eigen::VectorXd each =
        settling_times(map, starts(loop, law), period_s, result.decay_per_s);
    result.settling_s = each.maxCoeff();
    result.settling_mean_s = each.mean();
  }
  return result;
}

double modulus_margin(const SampledLoop& loop, double period_s) {
  const Response response(cut(loop, period_s), period_s);
  if (!(response.radius() < 1)) return 0;
  return least_over(response.frequencies(), [&](double w) { return response.modulus(w); });
}

Margins margins(const SampledLoop& loop, double period_s) {
  Margins result;
  const CutLoop open = cut(loop, period_s);
  const Response response(open, period_s);
  const numerics::ValueAt at_1{1, response.radius() - 1};
  if (!(at_1.value < 0)) return result;
  const std::vector<double> w = response.frequencies();
  result.modulus = least_over(w, [&](double x) { return response.modulus(x); });
  result.modulus_independent =
      least_over(w, [&](double x) { return response.smallest_singular_value(x); });
  Crossings crossings(response);
  crossings.find(response.frequencies(true), result);
  constexpr double factor = 1.1, largest_gain = 1e4, smallest_gain = 0.01;
  const auto excess = [&](double gain) { return spectral_radius(open.closed(gain)) - 1; };
  const auto limit = [&](double by, double most, double near) {
    return unstable_gain(excess, at_1, by, most, near);
  };
  result.gain = limit(factor, largest_gain, crossings.gain_above()).value_or(infinity);
  result.least_gain = limit(1 / factor, smallest_gain, crossings.gain_below()).value_or(0);
  return result;
}

MatrixXd stiffness_at_rest(LinearLaw law, const Eigen::VectorXd& scale,
                           const Eigen::VectorXd& springs, double period_s) {
  constexpr double slowly = 1e-3;  // [rad/s]
  law.D -= law.compensation;
  const MatrixXd feedback =
      scale.asDiagonal() * at_frequency({law, {}, true}, slowly, period_s).K.real();
  const Index n = law.D.rows();
  MatrixXd K = MatrixXd::Zero(n, n), by_theta = K;
  for (std::size_t i = 0; i < law.measured.size(); ++i) {
    const auto block = feedback.middleCols(static_cast<Index>(i) * n, n);
    if (law.measured[i] == Part::q || law.measured[i] == Part::theta) K -= block;
    if (law.measured[i] == Part::theta) by_theta -= block;
  }
  if (springs.size() == 0) return K;
  // A torque d on the links leaves theta = q - d / springs, and the motors' torque is -d.
  by_theta *= springs.cwiseInverse().asDiagonal();
  return numerics::inverse(MatrixXd::Identity(n, n) + by_theta) * K;
}

double radius_along(const std::function<MatrixXd(int)>& map_at, int ticks) {
  MatrixXd product = map_at(0);
  double log_size = 0;
  for (int k = 1; k < ticks; ++k) {
    product = map_at(k) * product;
    const double size = product.cwiseAbs().maxCoeff();
    if (size == 0) return 0;
    product /= size;
    log_size += std::log(size);
  }
  const double radius = spectral_radius(product);
  return radius == 0 ? 0 : std::exp((std::log(radius) + log_size) / ticks);
}

}  // namespace tachless::linear
