#include "commission/hypotheses.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

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
/// Share of the squared residuals that a spring must not exceed, and the frequency above which it
/// cannot be seen in motions below 8 Hz.
constexpr double spring_better = 0.1, stiffest_hz = 25;
constexpr double not_rigid = 0.1;   ///< least share of a motion that rigid joints do not explain
constexpr int friction_steps = 40;  ///< shares of the largest torque that are tried as friction
constexpr double softest_hz = 7.5, hz_ratio = 1.1;  ///< of the springs that are tried
/// Least shares of the expected fall, in squares: an arm with a fifth of it moved, and an arm with
/// less than a twentieth did not fall.
constexpr double moved_share = 0.04, no_fall_share = 0.0025;
/// Share of a fall that no parabola explains, and share of it that t^4 leaves, on springs.
constexpr double no_parabola = 0.01, quartic_better = 0.3;
/// Least fall [rad; m] that tells anything: a count of 18 bits is 2.4e-5 rad.
constexpr double smallest_fall = 2e-5;
/// Share of a movement's squares that a fall has to explain.
constexpr double explained_by_fall = 0.7;
/// Bounds of the acceleration over gravity's. Friction makes it slower; so does an arm that adds
/// gravity, but not of a load.
constexpr double slowest_fall = 0.6, fastest_fall = 1.3;
/// Share that rounding and friction leave unexplained even of the true signs, and factor of the
/// best signs' unexplained share up to which others are possible.
constexpr double always_unexplained = 0.0015, possible_factor = 4;
/// Ticks, and difference of two motions, that show an acceleration.
constexpr Eigen::Index least_seen = 5;
constexpr double seen_counts = 3;
constexpr Eigen::Index least_ticks = 20;  ///< of a trial that shows an answer
/// Gravity's acceleration [rad/s^2; m/s^2] below which the scale of a joint's torque is not told,
/// and the share by which its fall may differ from the expected one.
constexpr double least_pull = 1.5, fall_agrees = 0.1;
/// Scale that friction in both trials does not explain, if it changes the fall by this share.
constexpr double clearly_other = 3, gross = 0.2;

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

/// Returns what the columns do not explain of y.
VectorXd beyond(const MatrixXd& columns, const VectorXd& y) {
  return y - columns * columns.colPivHouseholderQr().solve(y);
}

/// Returns the torque that acts in the tick before each of some ticks.
VectorXd delayed(const VectorXd& tau, Eigen::Index from, Eigen::Index ticks, Eigen::Index delay) {
  VectorXd acts = VectorXd::Zero(ticks);
  for (Eigen::Index k = 0; k < ticks; ++k) {
    if (from + k > delay) acts[k] = tau[from + k - 1 - delay];
  }
  return acts;
}

/// Returns the motion from rest of a unit mass on a spring of frequency w under a force; w = 0: the
/// double integral.
VectorXd swing(const VectorXd& force, double w, double h) {
  VectorXd x(force.size());
  double position = 0, speed = 0;
  for (Eigen::Index k = 0; k < force.size(); ++k) {
    speed += h * (force[k] - w * w * position);
    position += h * speed;
    x[k] = position;
  }
  return x;
}

/// Returns the motion from rest of a unit mass with dry friction under a force.
VectorXd slide(const VectorXd& force, double friction, double h) {
  VectorXd x(force.size());
  double position = 0, speed = 0;
  for (Eigen::Index k = 0; k < force.size(); ++k) {
    const double along = speed != 0 ? speed : force[k];
    const double before = speed;
    if (before != 0 || std::abs(force[k]) > friction)
      speed += h * (force[k] - std::copysign(friction, along));
    if (speed * before < 0) speed = 0;
    position += h * speed;
    x[k] = position;
  }
  return x;
}

/// Returns t^2 / 2 from tick `onset` on.
VectorXd parabola(Eigen::Index ticks, int onset, double h) {
  const VectorXd t = VectorXd::LinSpaced(ticks, 0, static_cast<double>(ticks - 1));
  return ((t.array() - onset).cwiseMax(0) * h).square() / 2;
}

/// The best explanation of a joint's motion by a mass with dry friction.
struct Sliding {
  double share = 0;     ///< of the motion since the start that it explains alone
  double response = 0;  ///< as in `Answer`
  /// Sum of squares of the last motion that other columns beside it do not explain.
  double left = std::numeric_limits<double>::infinity();

  /// Tries frictions below the largest force of the last motion.
  /// @param others columns that explain the last motion
  void add(const VectorXd& force, double largest, const MatrixXd& others, const VectorXd& all,
           double h) {
    for (int step = 0; step < friction_steps; ++step) {
      const VectorXd motion = slide(force, largest * step / friction_steps, h);
      const double squares = std::max(1e-300, motion.squaredNorm()), along = motion.dot(all);
      MatrixXd columns(others.rows(), others.cols() + 1);
      columns << others, motion.tail(others.rows());
      left = std::min(left, beyond(columns, all.tail(others.rows())).squaredNorm());
      const double explained = along * along / squares / std::max(1e-300, all.squaredNorm());
      if (explained <= share) continue;
      share = explained;
      response = along / squares;
    }
  }
};

/// Returns the expected sum of squares of the rounding of positions to counts.
double rounding_of(const VectorXd& counts, Eigen::Index ticks) {
  return static_cast<double>(ticks) * counts.squaredNorm() / 12;
}

/// Returns whether a motion `x` along `a` has about this acceleration. A coarse encoder leaves the
/// onset open: each one is allowed that explains the motion as well as the best one does, up to
/// `rounding`.
bool is_as_fast(const MatrixXd& x, const VectorXd& a, double rounding, double h) {
  const VectorXd along = x * a / a.squaredNorm();
  std::array<double, longest_delay> left{}, as_fast{};
  for (std::size_t delay = 0; delay < left.size(); ++delay) {
    const VectorXd f = parabola(x.rows(), static_cast<int>(delay), h);
    as_fast[delay] = f.dot(along) / std::max(1e-300, f.squaredNorm());
    left[delay] = (x - as_fast[delay] * f * a.transpose()).squaredNorm();
  }
  const double least = *std::ranges::min_element(left);
  for (std::size_t delay = 0; delay < left.size(); ++delay) {
    if (left[delay] <= least + rounding && as_fast[delay] > slowest_fall &&
        as_fast[delay] < fastest_fall)
      return true;
  }
  return false;
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
  const Vector none = Vector::Zero(n);
  for (const Vector& each : signs_) {
    const Vector inertia = inverse_mass(each, none).diagonal().cwiseInverse();
    if (inertia_.size() == 0) inertia_ = least_inertia_ = inertia;
    least_inertia_ = least_inertia_.cwiseMin(inertia);
  }
}

MatrixXd ArmHypotheses::inverse_mass(const Vector& signs, const Vector& rotors) const {
  MatrixXd M = robot::mass_matrix(model_, turned(start_, signs, offset_));
  M.diagonal() += rotors;
  return M.llt().solve(MatrixXd::Identity(M.rows(), M.cols()));
}

Vector ArmHypotheses::below_mass_matrix(const Vector& rotors) const {
  Vector least = Vector::Constant(rotors.size(), std::numeric_limits<double>::infinity());
  for (const Vector& signs : signs_) {
    const MatrixXd inverse = inverse_mass(signs, rotors);
    const VectorXd root = inverse.diagonal().cwiseSqrt().cwiseInverse();
    const MatrixXd relative = root.asDiagonal() * inverse * root.asDiagonal();
    const double most = Eigen::SelfAdjointEigenSolver<MatrixXd>(relative).eigenvalues().maxCoeff();
    least = least.cwiseMin(Vector(root.cwiseAbs2() / most));
  }
  return least;
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
  const Vector stated = arm.fall(Vector::Ones(n));
  const VectorXd least = parabola(ticks, longest_delay - 1, h);  // seen after the longest delay
  const double expected = (least * weight.cwiseProduct(stated).transpose()).squaredNorm();
  // A link on a spring begins to fall as its motor does, with t^4.
  const auto unexplained = [&](const VectorXd& f) {
    return (x - f * (f.transpose() * x) / std::max(1e-300, f.squaredNorm())).squaredNorm();
  };
  double rigid = moved, spring = moved;
  int of_rigid = 0;
  for (int delay = 0; delay < longest_delay; ++delay) {
    const VectorXd f = parabola(ticks, delay, h);
    if (unexplained(f) < rigid) {
      rigid = unexplained(f);
      of_rigid = delay;
    }
    spring = std::min(spring, unexplained(f.cwiseAbs2()));
  }
  result.springs = rigid > no_parabola * moved && spring < quartic_better * rigid &&
                   x.cwiseAbs().maxCoeff() > answer_counts * count.cwiseProduct(weight).maxCoeff();
  const bool stopped = !trial.stopped.empty();
  const bool seen = stopped || (x.colwise().lpNorm<Eigen::Infinity>().transpose().array() >
                                answer_counts * count.cwiseProduct(weight).array())
                                   .any();
  result.moved = seen && (stopped || moved > moved_share * expected);
  if (result.moved && result.explained > explained_by_fall &&
      is_as_fast(x, weight.cwiseProduct(arm.fall(result.signs)),
                 rounding_of(count.cwiseProduct(weight), ticks), h)) {
    result.falls = true;
  }
  const bool visible = least[ticks - 1] * stated.cwiseAbs().maxCoeff() > smallest_fall;
  if (!stopped && visible && moved < no_fall_share * expected) result.falls = false;
  if (!result.falls.value_or(false)) result.onset = of_rigid;
  const VectorXd f = parabola(ticks, result.onset, h);
  result.acceleration =
      ((trial.q.rowwise() - trial.q.row(0)).transpose() * f) / std::max(1e-300, f.squaredNorm());
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
  const double fell = parabola(ticks, onset, h)[ticks - 1];
  for (Eigen::Index i = 0; i < n; ++i) {
    const double M = arm.inertial(as_stated, arm.start(), none, Vector::Unit(n, i))[i];
    const double as_gravity = falling[i] / arm.fall(as_stated)[i];  // friction explains the rest
    const bool usual = scale[i] > 0 && scale[i] < clearly_other;
    const bool rough = std::abs(pull[i]) < least_pull * M || std::abs(as_gravity - 1) > fall_agrees;
    const double least = seen_counts * count[i];
    const double change = std::abs(x(ticks - 1, i)), of_fall = std::abs(falling[i]) * fell;
    if ((usual && rough) || change < least ||
        (!usual && scale[i] > 0 && change < gross * of_fall) ||
        std::abs(share * pull[i] / arm.inertia()[i]) * fell < least)
      scale[i] = std::numeric_limits<double>::quiet_NaN();
  }
  return scale;
}

Answer answer_of(const Trial& trial, Eigen::Index joint, Eigen::Index ticks, double count,
                 double h) {
  ticks = std::min(ticks, trial.q.rows());
  if (ticks < least_ticks) return {};
  const Eigen::Index from = trial.q.rows() - ticks;
  const VectorXd q = trial.q.col(joint).segment(from, ticks), tau = trial.tau.col(joint);
  const VectorXd t = VectorXd::LinSpaced(ticks, -1, 1);
  MatrixXd drift(ticks, 3);
  drift << VectorXd::Ones(ticks), t, t.cwiseAbs2();
  Answer best;
  best.moved = q.maxCoeff() - q.minCoeff();
  const VectorXd power =
      tau.segment(from, ticks - 1).cwiseProduct(q.tail(ticks - 1) - q.head(ticks - 1));
  best.work = power.sum() / std::max(1e-300, power.lpNorm<1>());
  const double moved = beyond(drift, q).squaredNorm();
  double least = std::numeric_limits<double>::infinity(), least_of_spring = least, hz_of_spring = 0;
  Sliding sliding;
  const VectorXd all = trial.q.col(joint).array() - trial.q(0, joint);
  for (Eigen::Index delay = 0; delay <= longest_delay; ++delay) {
    const VectorXd acts = delayed(tau, from, ticks, delay);
    MatrixXd other(ticks, 4);
    other << drift, acts;
    const VectorXd integral = swing(acts, 0, h);
    const VectorXd rest = beyond(other, q), own = beyond(other, integral);
    const double response = own.dot(rest) / std::max(1e-300, own.squaredNorm());
    const double left = (rest - response * own).squaredNorm();
    if (left < least) {
      least = left;
      best.own = std::abs(response) * (own.maxCoeff() - own.minCoeff());
      best.response = response;
      best.explained = response * own.dot(rest) / std::max(1e-300, rest.squaredNorm());
      best.fits = 1 - left / std::max(1e-300, moved);
    }
    const VectorXd force = delayed(tau, 0, trial.q.rows(), delay);
    sliding.add(force, acts.lpNorm<Eigen::Infinity>(), other, all, h);
    for (double hz = softest_hz; hz < stiffest_hz; hz *= hz_ratio) {
      const double w = 2 * std::numbers::pi * hz;
      MatrixXd springy(ticks, 7);
      const VectorXd phase = VectorXd::LinSpaced(ticks, 0, w * h * static_cast<double>(ticks - 1));
      springy << drift, integral, swing(acts, w, h), phase.array().cos().matrix(),
          phase.array().sin().matrix();
      const double with_spring = beyond(springy, q).squaredNorm();
      if (with_spring >= least_of_spring) continue;
      least_of_spring = with_spring;
      hz_of_spring = hz;
    }
  }
  const double floor = static_cast<double>(ticks) * count * count;  // of what the encoder resolves
  const bool rigid = least < not_rigid * moved;
  if (!rigid && std::max(least_of_spring, floor) < spring_better * std::min(least, sliding.left))
    best.spring_hz = hz_of_spring;
  best.slides = sliding.share;
  best.sliding = sliding.response;
  return best;
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
