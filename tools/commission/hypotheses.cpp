#include "commission/hypotheses.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>

#include "identify/least_squares.h"
#include "robot/dynamics.h"

namespace tachless::commission {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Between rows of the regression; the low-pass removes faster motion.
constexpr double instant_s = 0.02;
constexpr double edge_s = 0.25;  ///< left out at both ends of a trial
/// Rows per independent row: the low-pass correlates neighbouring rows.
constexpr double dependent = 3;
constexpr double moving = 0.2;  ///< share of the largest speed below which dry friction is unclear
/// Residual over the torque that moves a joint, above which the joint tells little.
constexpr double noisy = 0.06;
/// Share of a joint's torque below which residuals count as equal.
constexpr double trusted = 5e-3;
/// Difference of 1 / scale from 1 that is no reason to look for a rotor, and the share of the
/// squared residuals that a rotor must not exceed.
constexpr double near_one = 0.15, clearly_better = 0.5;
/// Least shares of the expected fall, in squares: an arm with a fifth of it moved, and an arm with
/// less than a twentieth did not fall.
constexpr double moved_share = 0.04, no_fall_share = 0.0025;
/// Least fall [rad; m] that tells anything: a count of 18 bits is 2.4e-5 rad.
constexpr double smallest_fall = 2e-5;
/// Share of a movement's squares that a fall has to explain.
constexpr double explained_by_fall = 0.7;
/// Share that rounding and friction leave unexplained even of the true signs, and factor of the
/// best signs' unexplained share up to which others are possible.
constexpr double always_unexplained = 0.0015, possible_factor = 4;
/// Ticks, and difference of two motions, that show an acceleration.
constexpr Eigen::Index least_seen = 5;
constexpr double seen_counts = 5;
constexpr Eigen::Index least_ticks = 20;  ///< of a trial that shows an answer
/// Length of the end of a trial that shows an oscillation, and its least frequency. A joint
/// that runs away looks like a slower one.
constexpr double oscillation_s = 0.5, slowest_oscillation_hz = 7;
/// Gravity's acceleration [rad/s^2; m/s^2] below which the scale of a joint's torque is not told,
/// and the share by which its fall may differ from the expected one.
constexpr double least_pull = 1.5, fall_agrees = 0.1;

/// A sample of a trial.
struct Instant {
  std::size_t trial;
  Vector q, v, a, dry;                         ///< dry: sign(v), low-passed like the torques
  std::array<Vector, longest_delay + 3> sent;  ///< delayed by -1, 0, 1 … ticks
};

std::vector<Instant> instants(const std::vector<Trial>& trials, double h) {
  std::vector<Instant> all;
  for (std::size_t r = 0; r < trials.size(); ++r) {
    const MatrixXd q = identify::low_passed(trials[r].q, h);
    MatrixXd sent = trials[r].tau;
    const Eigen::Index ticks = q.rows(), edge = static_cast<Eigen::Index>(edge_s / h);
    // Mean torque about t_k, because each torque is held over its tick.
    sent.bottomRows(ticks - 1) =
        (0.5 * (trials[r].tau.topRows(ticks - 1) + trials[r].tau.bottomRows(ticks - 1))).eval();
    sent = identify::low_passed(std::move(sent), h);
    MatrixXd dry = MatrixXd::Zero(ticks, q.cols());
    for (Eigen::Index k = 1; k + 1 < ticks; ++k)
      dry.row(k) = (q.row(k + 1) - q.row(k - 1)).cwiseSign();
    dry = identify::low_passed(std::move(dry), h);
    const auto step = std::max<Eigen::Index>(1, static_cast<Eigen::Index>(instant_s / h));
    for (Eigen::Index k = edge; k < ticks - edge; k += step) {
      Instant at{r,
                 q.row(k).transpose(),
                 (q.row(k + 1) - q.row(k - 1)).transpose() / (2 * h),
                 (q.row(k + 1) - 2 * q.row(k) + q.row(k - 1)).transpose() / (h * h),
                 dry.row(k).transpose(),
                 {}};
      for (std::size_t d = 0; d < at.sent.size(); ++d) {
        at.sent[d] = sent.row(k + 1 - static_cast<Eigen::Index>(d)).transpose();
      }
      all.push_back(std::move(at));
    }
  }
  return all;
}

/// A fit of the sent torque of one joint for all delays: (needed torque) / scale + viscous v + dry
/// sign(v). If no scale near 1 fits, needed torque + rotor a + viscous v + dry sign(v) may fit
/// better: a rotor that the scenario does not state.
class JointFit {
 public:
  void add(double needed, const Instant& at, Eigen::Index joint) {
    const Eigen::Vector4d row(needed, at.a[joint], at.v[joint], at.dry[joint]);
    normal_ += row * row.transpose();
    for (std::size_t d = 0; d < at.sent.size(); ++d) {
      const double u = at.sent[d][joint];
      right_[d] += u * row;
      squares_[d] += u * u;
    }
    sum_ += at.sent[1][joint];
    needed_ += needed;
    ++count_;
  }
  struct Result {
    Eigen::Vector4d values;  ///< 1 / scale, rotor, viscous, dry
    /// Sum of squared residuals; the same with the floor `trusted`; standard deviation of `dry`.
    double left = 0, squares = 0, deviation = 0;
  };
  [[nodiscard]] Result solve(std::size_t d) const {
    const Result scaled = fit(d, 0);
    if (std::abs(scaled.values[0] - 1) < near_one) return scaled;
    const Result heavier = fit(d, 1);
    return heavier.left < clearly_better * scaled.left ? heavier : scaled;
  }
  [[nodiscard]] double count() const { return count_; }
  /// Returns the sum of squares of the torque that moves the joint, without its mean.
  [[nodiscard]] double moving_squares(const Eigen::Vector4d& values) const {
    const double mean = needed_ / std::max(1.0, count_);
    return values[0] * values[0] * (normal_(0, 0) - mean * needed_) +
           2 * values[0] * values[1] * normal_(0, 1) + values[1] * values[1] * normal_(1, 1);
  }
  /// Returns the negative log-likelihood up to a constant. One of `dependent` rows counts as
  /// independent.
  [[nodiscard]] double cost(std::size_t d) const {
    if (count_ < 10) return 0;
    return count_ / (2 * dependent) * std::log(std::max(1e-300, solve(d).squares / count_));
  }

 private:
  /// Fits the scale (`free` 0, without a rotor) or the rotor (`free` 1, with the scale 1).
  [[nodiscard]] Result fit(std::size_t d, Eigen::Index free) const {
    const std::array<Eigen::Index, 3> used = {free, 2, 3};
    const Eigen::Matrix3d normal = normal_(used, used);
    const double given = static_cast<double>(free);  // of the needed torque
    const Eigen::Vector3d right = right_[d](used) - given * normal_(used, 0);
    const double squares = squares_[d] + given * (normal_(0, 0) - 2 * right_[d][0]);
    const Eigen::Vector3d scale = normal.diagonal().cwiseSqrt().cwiseMax(1e-12).cwiseInverse();
    const Eigen::Matrix3d scaled = scale.asDiagonal() * normal * scale.asDiagonal();
    const Eigen::Matrix3d inverse =
        (scaled + 1e-10 * Eigen::Matrix3d::Identity()).ldlt().solve(Eigen::Matrix3d::Identity());
    Eigen::Vector3d values = scale.cwiseProduct(inverse * scale.cwiseProduct(right));
    // The model's torque never acts in the opposite direction, and no rotor is negative.
    if (values[0] < 0) values.setZero();
    const double left = squares - 2 * values.dot(right) + values.dot(normal * values);
    const double floored = std::max(left, count_ * trusted * trusted * variance());
    Result result{Eigen::Vector4d::Zero(), left, floored,
                  scale[2] * std::sqrt(inverse(2, 2) * floored / count_ * dependent)};
    result.values[0] = given;
    result.values(used) = values;
    return result;
  }
  [[nodiscard]] double variance() const {
    const double mean = sum_ / count_;
    return std::max(1e-12, squares_[1] / count_ - mean * mean);
  }

  Eigen::Matrix4d normal_ = Eigen::Matrix4d::Zero();
  std::array<Eigen::Vector4d, longest_delay + 3> right_ = zeros();
  std::array<double, longest_delay + 3> squares_{};
  double sum_ = 0, needed_ = 0, count_ = 0;

  static std::array<Eigen::Vector4d, longest_delay + 3> zeros() {
    std::array<Eigen::Vector4d, longest_delay + 3> all;
    all.fill(Eigen::Vector4d::Zero());
    return all;
  }
};

/// The fits and costs of one hypothesis; `cost` has an entry for each delay from 0.
struct Candidate {
  Vector signs;
  bool gravity;
  std::vector<JointFit> joints;
  std::array<double, longest_delay + 1> cost{};

  [[nodiscard]] std::size_t delay() const {
    return static_cast<std::size_t>(std::ranges::min_element(cost) - cost.begin());
  }
  [[nodiscard]] double least() const { return *std::ranges::min_element(cost); }
};

/// Returns the delay at the vertex of the parabola through the residuals beside the best delay.
double fractional_delay(const JointFit& joint, std::size_t d) {
  const double before = joint.solve(d).left, at = joint.solve(d + 1).left,
               after = joint.solve(d + 2).left;
  const double bend = before - 2 * at + after;
  const double shift = bend > 0 ? 0.5 * (before - after) / bend : 0;
  return static_cast<double>(d) + std::clamp(shift, -1.0, 1.0);
}

/// Returns t^2 / 2 from tick `onset` on.
VectorXd parabola(Eigen::Index ticks, int onset, double h) {
  const VectorXd t = VectorXd::LinSpaced(ticks, 0, static_cast<double>(ticks - 1));
  return ((t.array() - onset).cwiseMax(0) * h).square() / 2;
}

}  // namespace

ArmHypotheses::ArmHypotheses(const scenario::Scenario& scenario)
    : model_(*scenario.model),
      offset_(scenario.robot.joint_offsets_rad),
      start_(scenario.plant.initial.position_rad) {
  if (scenario.robot.flexible) {
    throw scenario.complaint("robot.joints", "flexible; commission is for rigid joints");
  }
  const int n = scenario.num_joints;
  if (n > most_joints) {
    throw scenario.complaint("robot.urdf", "{} joints; commission is for at most {}: lock some", n,
                             most_joints);
  }
  model_.rotor_inertia = scenario.robot.rigid_rotor_inertia_kgm2;
  for (unsigned bits = 0; bits < 1U << static_cast<unsigned>(n); ++bits) {
    Vector each(n);
    for (int i = 0; i < n; ++i) each[i] = (bits >> static_cast<unsigned>(i) & 1U) != 0U ? -1 : 1;
    const Vector q = turned(start_, each, offset_);
    const bool inside =
        ((q - model_.lower).array() >= -0.01).all() && ((model_.upper - q).array() >= -0.01).all();
    if (bits == 0 || inside) signs_.push_back(each);
  }
  const Eigen::MatrixXd M = robot::mass_matrix(model_, start_);
  inertia_ =
      Eigen::MatrixXd(M.llt().solve(Eigen::MatrixXd::Identity(n, n))).diagonal().cwiseInverse();
}

Vector ArmHypotheses::inertial(const Vector& signs, const Vector& q, const Vector& v,
                               const Vector& a) const {
  const Vector at = turned(q, signs, offset_);
  const Vector all =
      robot::inverse_dynamics<double>(model_, at, signs.cwiseProduct(v), signs.cwiseProduct(a));
  return signs.cwiseProduct(all - robot::gravity_torque(model_, at));
}

Vector ArmHypotheses::gravity(const Vector& signs, const Vector& q) const {
  const Vector at = turned(q, signs, offset_);
  return signs.cwiseProduct(robot::gravity_torque(model_, at));
}

Vector ArmHypotheses::fall(const Vector& signs, const Vector& tau) const {
  const Vector at = turned(start_, signs, offset_);
  const Vector none = Vector::Zero(at.size());
  return signs.cwiseProduct(robot::forward_dynamics(
      model_, at, none, tau.size() == 0 ? none : Vector(signs.cwiseProduct(tau))));
}

Fall judge_fall(const ArmHypotheses& arm, const Trial& trial, const Vector& count, double h) {
  const Eigen::Index n = trial.q.cols(), ticks = trial.q.rows();
  const VectorXd weight = arm.inertia().cwiseSqrt();
  const MatrixXd x = (trial.q.rowwise() - trial.q.row(0)) * weight.asDiagonal();
  const double moved = x.squaredNorm();
  Fall result;
  result.signs = Vector::Ones(n);
  result.certain = Vector::Zero(n);
  std::vector<double> explained;  // best share for each entry of arm.signs()
  for (const Vector& signs : arm.signs()) {
    const VectorXd a = weight.cwiseProduct(arm.fall(signs));
    const VectorXd along = x * a;
    double best = 0;
    for (int delay = 0; delay < longest_delay; ++delay) {
      const VectorXd f = parabola(ticks, delay, h);
      const double part = std::max(0.0, f.dot(along));
      const double share =
          part * part / std::max(1e-300, f.squaredNorm() * a.squaredNorm() * moved);
      best = std::max(best, share);
      if (share <= result.explained) continue;
      result.explained = share;
      result.signs = signs;
      result.onset = delay;
    }
    explained.push_back(best);
  }
  const VectorXd f = parabola(ticks, result.onset, h);
  result.acceleration =
      ((trial.q.rowwise() - trial.q.row(0)).transpose() * f) / std::max(1e-300, f.squaredNorm());
  const Vector stated = arm.fall(Vector::Ones(n));
  const VectorXd least = parabola(ticks, longest_delay - 1, h);  // seen after the longest delay
  const double expected = (least * weight.cwiseProduct(stated).transpose()).squaredNorm();
  const bool stopped = !trial.stopped.empty();
  const bool seen = stopped || (x.colwise().lpNorm<Eigen::Infinity>().transpose().array() >
                                answer_counts * count.cwiseProduct(weight).array())
                                   .any();
  result.moved = seen && (stopped || moved > moved_share * expected);
  if (result.moved && result.explained > explained_by_fall) result.falls = true;
  const bool visible = least[ticks - 1] * stated.cwiseAbs().maxCoeff() > smallest_fall;
  if (!stopped && visible && moved < no_fall_share * expected) result.falls = false;
  if (!result.falls.value_or(false)) return result;
  result.certain = result.signs;
  for (std::size_t k = 0; k < explained.size(); ++k) {
    const double unexplained = always_unexplained + possible_factor * (1 - result.explained);
    if (1 - explained[k] > unexplained) continue;
    result.possible.push_back(arm.signs()[k]);
    for (Eigen::Index i = 0; i < n; ++i) {
      if (arm.signs()[k][i] != result.signs[i]) result.certain[i] = 0;
    }
  }
  return result;
}

Vector scale_of_hold(const ArmHypotheses& arm, const Vector& falling, int onset, const Trial& trial,
                     double share, const Vector& count, double h) {
  const Eigen::Index n = trial.q.cols(), ticks = trial.q.rows();
  const Vector as_stated = Vector::Ones(n);
  const MatrixXd x =
      (trial.q.rowwise() - trial.q.row(0)) - parabola(ticks, onset, h) * falling.transpose();
  double least = std::numeric_limits<double>::infinity();
  Vector added = Vector::Constant(n, std::numeric_limits<double>::quiet_NaN());
  for (int delay = onset; delay < longest_delay; ++delay) {
    if (delay > onset && delay + least_seen > ticks) break;
    const VectorXd f = parabola(ticks, delay, h);
    const VectorXd a = x.transpose() * f / f.squaredNorm();
    const double left = (x - f * a.transpose()).squaredNorm();
    if (!(left < least)) continue;
    least = left;
    added = a;
  }
  const Vector none = Vector::Zero(n), pull = arm.gravity(as_stated, arm.start());
  Vector scale = arm.inertial(as_stated, arm.start(), none, added).cwiseQuotient(share * pull);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double M = arm.inertial(as_stated, arm.start(), none, Vector::Unit(n, i))[i];
    const double as_gravity = falling[i] / arm.fall(as_stated)[i];  // friction explains the rest
    if (std::abs(pull[i]) < least_pull * M || std::abs(as_gravity - 1) > fall_agrees ||
        std::abs(x(ticks - 1, i)) < seen_counts * count[i])
      scale[i] = std::numeric_limits<double>::quiet_NaN();
  }
  return scale;
}

Answer answer_of(const Trial& trial, Eigen::Index joint, Eigen::Index from, Eigen::Index ticks,
                 double h) {
  ticks = std::min(ticks, trial.q.rows() - from);
  if (ticks < least_ticks) return {};
  MatrixXd columns(ticks, 4);
  double impulse = 0, moved = 0;
  for (Eigen::Index k = 0; k < ticks; ++k) {
    const double t = static_cast<double>(k) / static_cast<double>(ticks);
    columns.row(k) << 1, t, t * t, moved;
    moved += h * impulse;
    impulse += h * trial.tau(from + k, joint);
  }
  const VectorXd q = trial.q.col(joint).segment(from, ticks);
  const auto basis = columns.leftCols(3).householderQr();
  const VectorXd rest = q - columns.leftCols(3) * basis.solve(q);
  const VectorXd own = columns.col(3) - columns.leftCols(3) * basis.solve(columns.col(3));
  const double response = own.dot(rest) / std::max(1e-300, own.squaredNorm());
  const VectorXd u = trial.tau.col(joint).segment(from, ticks - 1).array() - trial.tau(from, joint);
  const VectorXd power = u.cwiseProduct(q.tail(ticks - 1) - q.head(ticks - 1));
  return {q.maxCoeff() - q.minCoeff(), std::abs(response) * (own.maxCoeff() - own.minCoeff()),
          response, response * own.dot(rest) / std::max(1e-300, rest.squaredNorm()),
          power.sum() / std::max(1e-300, power.lpNorm<1>())};
}

double oscillation_hz(const Trial& trial, Eigen::Index joint, double count, double h) {
  const auto window = static_cast<Eigen::Index>(oscillation_s / h);
  if (trial.q.rows() < window) return 0;
  const VectorXd q = trial.q.col(joint).tail(window);
  const VectorXd t = VectorXd::LinSpaced(window, -1, 1);
  MatrixXd columns(window, 4);
  columns << VectorXd::Ones(window), t, t.cwiseAbs2(), t.array().cube().matrix();
  const VectorXd rest = q - columns * columns.householderQr().solve(q);
  if (rest.squaredNorm() < answer_counts * answer_counts * count * count * window) return 0;
  int crossings = 0;
  for (Eigen::Index k = 1; k < window; ++k) crossings += rest[k] * rest[k - 1] < 0 ? 1 : 0;
  const double hz = crossings / (2 * oscillation_s);
  return hz > slowest_oscillation_hz ? hz : 0;
}

Explanation explain(const ArmHypotheses& arm, const std::vector<Trial>& trials, double h,
                    const std::vector<bool>& answers, const Vector& certain,
                    std::optional<bool> gravity) {
  const std::vector<Instant> rows = instants(trials, h);
  const auto n = static_cast<std::size_t>(trials.front().q.cols());
  Vector fastest = Vector::Zero(static_cast<Eigen::Index>(n));
  for (const Instant& at : rows) fastest = fastest.cwiseMax(at.v.cwiseAbs());
  std::vector<Candidate> all;
  for (const Vector& signs : arm.signs()) {
    if ((signs.cwiseProduct(certain).array() < 0).any()) continue;
    Candidate without{signs, false, std::vector<JointFit>(n), {}}, with = without;
    with.gravity = true;
    for (const Instant& at : rows) {
      const Vector needed = arm.inertial(signs, at.q, at.v, at.a);
      const Vector pull = arm.gravity(signs, at.q);
      for (std::size_t j = 0; j < n; ++j) {
        const auto i = static_cast<Eigen::Index>(j);
        if (!answers[j] || (at.trial != j && at.trial != n)) continue;
        if (std::abs(at.v[i]) < moving * fastest[i]) continue;
        without.joints[j].add(needed[i], at, i);
        with.joints[j].add(needed[i] + pull[i], at, i);
      }
    }
    for (Candidate* each : {&without, &with}) {
      if (gravity && *gravity != each->gravity) continue;
      for (std::size_t d = 0; d < each->cost.size(); ++d) {
        for (const JointFit& joint : each->joints) each->cost[d] += joint.cost(d + 1);
      }
      all.push_back(std::move(*each));
    }
  }
  const Candidate& best = *std::ranges::min_element(all, {}, &Candidate::least);
  Explanation result{{best.signs}, best.gravity, static_cast<int>(best.delay()), {}, best.least()};
  for (const Candidate& each : all) {
    if (each.least() - best.least() > clear) continue;
    if (each.signs != best.signs) result.signs.push_back(each.signs);
    if (each.gravity != best.gravity) result.gravity.reset();
  }
  for (std::size_t j = 0; j < n; ++j) {
    const JointFit& fit = best.joints[j];
    const JointFit::Result found = fit.solve(best.delay() + 1);
    result.joints.push_back({found.values[0] > 0 ? 1 / found.values[0] : 0, found.values[1],
                             found.values[2], found.values[3],
                             std::sqrt(found.squares / std::max(1.0, fit.count())),
                             fractional_delay(fit, best.delay()), found.deviation,
                             found.left < noisy * noisy * fit.moving_squares(found.values)});
  }
  return result;
}

}  // namespace tachless::commission
