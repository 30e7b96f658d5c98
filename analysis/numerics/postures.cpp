#include "numerics/postures.h"

#include <nlopt.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <limits>
#include <memory>
#include <numbers>
#include <numeric>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "base/parallel.h"
#include "numerics/decompositions.h"
#include "robot/dynamics.h"

namespace tachless::numerics {
namespace {

/// Data that NLopt passes to its callback.
struct Search {
  const std::function<double(const Eigen::VectorXd&)>& f;
  Minimum best;
  std::exception_ptr failure;
  nlopt_opt handle = nullptr;
};

// NLopt does not document how it treats infinite values. This large number replaces them.
constexpr double out_of_range = 1e300;

double evaluate(unsigned n, const double* x, double* /*gradient*/, void* data) {
  Search& search = *static_cast<Search*>(data);
  try {
    const Eigen::VectorXd point = Eigen::Map<const Eigen::VectorXd>(x, n);
    const double value = search.f(point);
    if (!(value < out_of_range)) return out_of_range;
    if (value < search.best.value) search.best = {point, value};
    if (value > -infinity) return value;
    nlopt_force_stop(search.handle);  // no value is less
    return -out_of_range;
  } catch (...) {  // an exception must not cross C code
    search.failure = std::current_exception();
    nlopt_force_stop(search.handle);
    return out_of_range;
  }
}

using Optimiser = std::unique_ptr<nlopt_opt_s, decltype(&nlopt_destroy)>;

Optimiser optimiser(nlopt_algorithm algorithm, const Eigen::VectorXd& start, int max_evaluations) {
  Optimiser opt(nlopt_create(algorithm, static_cast<unsigned>(start.size())), &nlopt_destroy);
  nlopt_set_maxeval(opt.get(), max_evaluations);
  nlopt_set_xtol_abs1(opt.get(), 1e-5);
  nlopt_set_ftol_rel(opt.get(), 1e-8);
  return opt;
}

/// Returns what the search finds, whatever ends it. @throw std::logic_error if it cannot begin
Minimum minimum(const Optimiser& opt, const std::function<double(const Eigen::VectorXd&)>& f,
                const Eigen::VectorXd& start) {
  Search search{f, {start, out_of_range}, nullptr, opt.get()};
  nlopt_set_min_objective(opt.get(), evaluate, &search);
  Eigen::VectorXd x = start;
  double value = 0;
  if (nlopt_optimize(opt.get(), x.data(), &value) == NLOPT_INVALID_ARGS) {
    throw std::logic_error("the arguments of a local search contradict each other");
  }
  if (search.failure) std::rethrow_exception(search.failure);
  return search.best;
}

/// Returns whether every body hangs on joint 0, in which case M and C do not depend on it.
bool all_hang_on_first_joint(const robot::Model& model) {
  return std::all_of(model.bodies.begin(), model.bodies.end(), [&](const robot::Body& body) {
    const bool first = &body == &model.bodies.front();
    return first == (body.parent < 0) && first == (body.coordinate == 0);
  });
}

/// Adds s b to a.
void add_scaled(Inertia& a, double s, const Inertia& b) {
  a.M += s * b.M;
  for (std::size_t j = 0; j < a.C.size(); ++j) a.C[j] += s * b.C[j];
}

double size_of(const Inertia& x) {
  double largest = x.M.cwiseAbs().maxCoeff();
  for (const Eigen::MatrixXd& C : x.C) largest = std::max(largest, C.cwiseAbs().maxCoeff());
  return largest;
}

Vector second_joint_at(double q2) {
  Vector q(2);
  q << 0, q2;
  return q;
}

/// Returns the interval of one joint's coordinate over which postures are spread [rad; m].
std::pair<double, double> range_of(const robot::Model& model, int i) {
  if (model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::revolute) {
    return {-std::numbers::pi, std::numbers::pi};
  }
  return {std::isfinite(model.lower[i]) ? model.lower[i] : -1,
          std::isfinite(model.upper[i]) ? model.upper[i] : 1};
}

/// Returns the postures of a robot: prismatic joints keep within their range.
Box box_of(const robot::Model& model) {
  Box box{Eigen::VectorXd::Constant(model.num_joints, -infinity),
          Eigen::VectorXd::Constant(model.num_joints, infinity)};
  for (int i = 0; i < model.num_joints; ++i) {
    if (model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::revolute) continue;
    std::tie(box.lower[i], box.upper[i]) = range_of(model, i);
  }
  return box;
}

/// Returns a local minimum of f from `start` on. A search that ends in another box than it began
/// goes on there.
/// @param box_around the box in which a search from a posture stays
Minimum refined(const std::function<double(const Vector&)>& f,
                const std::function<Box(const Vector&)>& box_around, Vector start,
                int max_evaluations) {
  constexpr double first_step = 0.2;  // [rad; m]
  constexpr int most_boxes = 4;       // a cap: boxes of neighbouring centres overlap
  Minimum found;
  Box box = box_around(start);
  for (int k = 0; k < most_boxes; ++k) {
    found = minimise_within(f, start, box, first_step, max_evaluations);
    start = found.x;
    Box next = box_around(start);
    if (next.lower == box.lower) break;
    box = std::move(next);
  }
  return found;
}

/// Returns the smallest f over the postures `q`, at which f has the values `value`. Refines the
/// best `starts` of them locally, each with at most `max_evaluations` evaluations in a box. With
/// `max_evaluations` 0 there is no refinement.
Extreme smallest_of(const std::function<Box(const Vector&)>& box_around,
                    const std::function<double(const Vector&)>& f, const std::vector<Vector>& q,
                    const std::vector<double>& value, std::size_t starts, int max_evaluations) {
  std::vector<std::size_t> order(q.size());
  std::iota(order.begin(), order.end(), 0);
  starts = std::min(starts, q.size());
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(starts), order.end(),
                    [&](std::size_t a, std::size_t b) { return value[a] < value[b]; });
  if (max_evaluations == 0) return {value[order[0]], q[order[0]]};
  const std::vector<Minimum> all = base::parallel_map(
      starts, [&](std::size_t i) { return refined(f, box_around, q[order[i]], max_evaluations); });
  const Minimum& best = *std::ranges::min_element(all, {}, &Minimum::value);
  return {best.value, best.x};
}

/// Computes the Fourier sums of M and C over q2. A body turned by the angle m q2 enters M and C
/// with at most 2 |m| turns. The angles of a chain of mimic joints add up. The samples resolve
/// 32 turns. Returns false when a harmonic above 16 turns is more than a rounding error.
bool find_harmonics(Postures& postures, int denominator, double& period) {
  const int num_samples = 64 * denominator;
  std::vector<Inertia> sample;
  for (int k = 0; k < num_samples; ++k) {
    const double q2 = 2 * std::numbers::pi * denominator * k / num_samples;
    sample.push_back(inertia_at(postures.model, second_joint_at(q2)));
  }
  const double rounding = 1e-13 * size_of(sample[0]);
  int common = 0;
  for (int order = 1; order < num_samples / 2; ++order) {
    Postures::Harmonic h{static_cast<double>(order) / denominator, sample[0], sample[0]};
    add_scaled(h.cosine, -1, sample[0]);
    add_scaled(h.sine, -1, sample[0]);
    for (int k = 0; k < num_samples; ++k) {
      // The product is reduced in integers because order k may be large.
      const double angle = 2 * std::numbers::pi * (order * k % num_samples) / num_samples;
      add_scaled(h.cosine, 2.0 / num_samples * std::cos(angle),
                 sample[static_cast<std::size_t>(k)]);
      add_scaled(h.sine, 2.0 / num_samples * std::sin(angle), sample[static_cast<std::size_t>(k)]);
    }
    if (std::max(size_of(h.cosine), size_of(h.sine)) <= rounding) continue;
    if (order > num_samples / 4) return false;
    common = std::gcd(common, order);
    postures.harmonics.push_back(std::move(h));
  }
  period = common == 0 ? 0 : 2 * std::numbers::pi * denominator / common;
  return true;
}

}  // namespace

int multiplier_denominator(const robot::Model& model) {
  for (int d = 1; d <= 8; ++d) {
    if (std::all_of(model.bodies.begin(), model.bodies.end(), [&](const robot::Body& body) {
          const double m = body.multiplier * d;
          return std::abs(m - std::round(m)) < 1e-12;
        })) {
      return d;
    }
  }
  return 0;
}

Eigen::VectorXd most_turns(const robot::Model& model) {
  Eigen::VectorXd most = Eigen::VectorXd::Zero(model.num_joints);
  std::vector<Eigen::VectorXd> along;  // of the joints from the root to each body
  for (const robot::Body& body : model.bodies) {
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(model.num_joints);
    if (body.parent >= 0) sum = along[static_cast<std::size_t>(body.parent)];
    sum[body.coordinate] += std::abs(body.multiplier);
    most = most.cwiseMax(sum);
    along.push_back(std::move(sum));
  }
  return most;
}

Minimum minimise(const std::function<double(const Eigen::VectorXd&)>& f,
                 const Eigen::VectorXd& start, double step, int max_evaluations) {
  const Optimiser opt = optimiser(NLOPT_LN_SBPLX, start, max_evaluations);
  nlopt_set_initial_step1(opt.get(), step);
  return minimum(opt, f, start);
}

Minimum minimise_within(const std::function<double(const Eigen::VectorXd&)>& f,
                        const Eigen::VectorXd& start, const Box& box, double step,
                        int max_evaluations) {
  // The first model takes points on both sides of the start.
  const Eigen::VectorXd steps = (0.4 * (box.upper - box.lower)).cwiseMin(step);
  const Optimiser opt = optimiser(NLOPT_LN_BOBYQA, start, max_evaluations);
  nlopt_set_lower_bounds(opt.get(), box.lower.data());
  nlopt_set_upper_bounds(opt.get(), box.upper.data());
  nlopt_set_initial_step(opt.get(), steps.data());
  return minimum(opt, f, start.cwiseMax(box.lower).cwiseMin(box.upper));
}

Inertia inertia_at(const robot::Model& model, const Vector& q) {
  return {robot::mass_matrix(model, q), robot::coriolis_matrices(model, q)};
}

std::vector<Eigen::MatrixXd> coriolis_along(const std::vector<Eigen::MatrixXd>& C,
                                            const Eigen::MatrixXd& S) {
  std::vector<Eigen::MatrixXd> all;
  for (Eigen::Index j = 0; j < S.cols(); ++j) {
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(S.rows(), S.rows());
    for (Eigen::Index i = 0; i < S.rows(); ++i) sum += S(i, j) * C[static_cast<std::size_t>(i)];
    all.push_back(std::move(sum));
  }
  return all;
}

Vector spread_posture(const robot::Model& model, int k) {
  const int n = model.num_joints;
  double ratio = 2;  // the root of x^(n+1) = x + 1; the golden ratio for n = 1
  for (int i = 0; i < 60; ++i) ratio = std::pow(1 + ratio, 1.0 / (n + 1));
  Vector q(n);
  for (int i = 0; i < n; ++i) {
    const double turns = 0.5 + (k + 1) * std::pow(ratio, -(i + 1));
    const double part = turns - std::floor(turns);
    const auto [low, high] = range_of(model, i);
    q[i] = low + part * (high - low);
  }
  return q;
}

Extreme largest(const robot::Model& model, const std::function<double(const Vector&)>& f,
                int samples) {
  std::vector<Vector> q(static_cast<std::size_t>(samples));
  const std::vector<double> value = base::parallel_map(q.size(), [&](std::size_t i) {
    q[i] = spread_posture(model, static_cast<int>(i));
    return -f(q[i]);
  });
  Extreme best = smallest_of([&](const Vector& /*x*/) { return box_of(model); },
                             [&](const Vector& x) { return -f(x); }, q, value, 6, 1000);
  for (int i = 0; i < model.num_joints; ++i) {
    if (model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::revolute) {
      best.q[i] = std::remainder(best.q[i], 2 * std::numbers::pi);
    }
  }
  return {-best.value, best.q};
}

Postures::Postures(robot::Model of, const PostureOptions& options)
    : model(std::move(of)), centres(options.centres), reach(options.reach) {
  const bool hang = all_hang_on_first_joint(model);
  const int denominator = multiplier_denominator(model);
  if (hang && model.num_joints == 1) {
    kind = Kind::point;
    proved = true;
    q.push_back(Vector::Zero(1));
  } else if (hang && model.num_joints == 2 && denominator > 0 &&
             model.joint_types[0] == robot::JointType::revolute &&
             model.joint_types[1] == robot::JointType::revolute) {
    kind = Kind::circle;
    double period = 2 * std::numbers::pi * denominator;
    proved = find_harmonics(*this, denominator, period) && options.bound_between;
    if (!proved) harmonics.clear();
    const int num_points = period == 0 ? 1 : options.circle_points;
    const double step = period / num_points;
    chord_factor = proved ? step * step / 8 : 0;
    for (int k = 0; k < num_points; ++k) q.push_back(second_joint_at(step * k));
  } else {
    for (int k = 0; k < options.samples; ++k) {
      Vector posture = spread_posture(model, k);
      if (!centres.empty()) {
        const double share = std::fmod(k / std::numbers::phi, 1);
        const Vector& centre = centres[static_cast<std::size_t>(share * centres.size())];
        for (int i = 0; i < model.num_joints; ++i) {
          const auto [low, high] = range_of(model, i);
          posture[i] = centre[i] + reach[i] * (2 * posture[i] - low - high) / (high - low);
        }
      }
      q.push_back(std::move(posture));
    }
  }
  inertia = base::parallel_map(q.size(), [&](std::size_t i) { return inertia_at(model, q[i]); });
}

void Postures::add(const Vector& posture) {
  q.push_back(posture);
  inertia.push_back(inertia_at(model, posture));
}

Box Postures::box_around(const Vector& posture) const {
  if (centres.empty()) return box_of(model);
  const Vector& nearest = *std::ranges::min_element(centres, {}, [&](const Vector& centre) {
    return (posture - centre).cwiseAbs().cwiseQuotient(reach).maxCoeff();
  });
  return {nearest - reach, nearest + reach};
}

Extreme Postures::smallest(const std::function<Function(double)>& f_up_to,
                           const Search& search) const {
  constexpr std::size_t starts = 3, first = 32;
  // After the first postures and each doubling of their number, a value is of use only if it is
  // among the least ones so far.
  std::vector<double> value, least;
  const Function f_everywhere = f_up_to(infinity);
  Function f = f_everywhere;
  std::atomic<bool> ended = false;
  const auto value_at = [&](std::size_t i) {
    if (ended) return -infinity;
    const double found = f(inertia[i]);
    if (found <= search.above && search.above > -infinity) ended = true;
    return found;
  };
  while (value.size() < q.size()) {
    const std::size_t begin = value.size();
    const std::size_t count = std::min(std::max(begin, first), q.size() - begin);
    for (const double each :
         base::parallel_map(count, [&](std::size_t i) { return value_at(begin + i); })) {
      value.push_back(each);
    }
    if (ended) return {-infinity, {}};
    if (value.size() < starts || value.size() == q.size()) continue;
    least = value;
    std::ranges::nth_element(least, least.begin() + (starts - 1));
    f = f_up_to(least[starts - 1]);
  }
  const bool M_alone = search.reads == Reads::M;
  const auto anywhere = [&](const Vector& at) {
    return f_everywhere(M_alone ? Inertia{robot::mass_matrix(model, at), {}}
                                : inertia_at(model, at));
  };
  return smallest_of([&](const Vector& at) { return box_around(at); }, anywhere, q, value, starts,
                     search.refine && kind == Kind::sampled ? 300 : 0);
}

}  // namespace tachless::numerics
