#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "certify/certify.h"
#include "controller/laws.h"
#include "controller/registry.h"
#include "design/design.h"
#include "numerics/decompositions.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"
#include "tests/analysis/linear/scenarios.h"
#include "tests/analysis/lyapunov/decrease.h"

/// Searches states inside the printed regions at which V grows. Loop, V and Vdot are those of the
/// mechanics and of the law in continuous time; nothing is taken from the matrix condition.
namespace tachless::lyapunov::inside_region_test {
namespace {

using controller::law::LoriaOrtegaFlexible;
using controller::law::LyapunovWeights;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using linear::testing::shipped;

/// Arm, law and filters in continuous time, with V.
class TrueLoop {
 public:
  explicit TrueLoop(const scenario::Scenario& scenario)
      : trajectory_(reference::make_trajectory(scenario)), n_(scenario.num_joints) {}
  TrueLoop(const TrueLoop&) = delete;
  TrueLoop& operator=(const TrueLoop&) = delete;
  virtual ~TrueLoop() = default;

  /// Number of errors: links, and motors where joints are flexible.
  [[nodiscard]] virtual Eigen::Index errors() const = 0;
  /// Number of coordinates of the error state (e, nu, edot), and of an integral after them.
  [[nodiscard]] virtual Eigen::Index size() const { return 3 * errors(); }
  /// Returns the state from an error state.
  [[nodiscard]] virtual VectorXd state(double t_s, const VectorXd& x) const = 0;
  [[nodiscard]] virtual VectorXd derivative(double t_s, const VectorXd& state) const = 0;
  [[nodiscard]] virtual double V(double t_s, const VectorXd& state,
                                 const LyapunovWeights& weights) const = 0;
  /// Returns an error state with a V of about |z|^2 / 2 where the weights are small.
  [[nodiscard]] virtual VectorXd from_units(const VectorXd& z) const = 0;

  /// Returns dV/dt along the loop's motion: differences of the fourth order, whose error is below
  /// 1e-6 V per second. The state needs no more than its first derivative in central differences.
  [[nodiscard]] double Vdot(double t_s, const VectorXd& state,
                            const LyapunovWeights& weights) const {
    const VectorXd rate = derivative(t_s, state);
    const auto slope = [&](double h) {
      return (V(t_s + h, state + h * rate, weights) - V(t_s - h, state - h * rate, weights)) /
             (2 * h);
    };
    return (4 * slope(step_s) - slope(2 * step_s)) / 3;
  }
  static constexpr double step_s = 1e-6;

  [[nodiscard]] const reference::Trajectory& trajectory() const { return trajectory_; }

 protected:
  /// Returns M edot of a rigid body: what inverse dynamics adds for an acceleration.
  static Vector momentum(const robot::Model& links, const Vector& q, const Vector& edot) {
    const Vector none = Vector::Zero(q.size());
    return robot::inverse_dynamics<double>(links, q, none, edot) - robot::gravity_torque(links, q);
  }
  /// Returns L^-T z, A = L L'.
  static VectorXd unscaled(const MatrixXd& A, const VectorXd& z) {
    return A.llt().matrixU().solve(z);
  }

  reference::Trajectory trajectory_;
  Eigen::Index n_;
};

/// tau = ID(q, v_ref, a_ref) - Kp e - Kd nu, and -Ki y of the law with an integral. Viscous
/// friction brakes edot alone: its rest is a disturbance, which the region does not contain.
template <class L>
class RigidLoop : public TrueLoop {
 public:
  explicit RigidLoop(const scenario::Scenario& scenario)
      : TrueLoop(scenario),
        law_(controller::make_law<L>(scenario)),
        arm_(controller::rigid_model(scenario)),
        D_(scenario.plant.drive.viscous_friction_Nms_per_rad) {
    if constexpr (requires { law_.weights(); }) {
      ki_ = controller::gains_of<typename L::Gains>(scenario, controller::law_facts(L::name)).ki;
    }
  }

  [[nodiscard]] Eigen::Index errors() const override { return n_; }
  [[nodiscard]] Eigen::Index size() const override { return 3 * n_ + ki_.size(); }

  [[nodiscard]] VectorXd state(double t_s, const VectorXd& x) const override {
    const messages::ReferencePoint r = trajectory_.at(t_s);
    VectorXd s = x;
    s.head(n_) += VectorXd(r.q_ref);
    s.segment(2 * n_, n_) += VectorXd(r.v_ref);
    return s;
  }

  [[nodiscard]] VectorXd derivative(double t_s, const VectorXd& s) const override {
    const messages::ReferencePoint r = trajectory_.at(t_s);
    const Vector q = s.head(n_), nu = s.segment(n_, n_), v = s.segment(2 * n_, n_);
    const Vector e = q - r.q_ref, edot = v - r.v_ref;
    const Vector forward = robot::inverse_dynamics<double>(arm_, q, r.v_ref, r.a_ref);
    Vector tau = law_.feedback(forward, e, nu, r);
    if (ki_.size() > 0) tau -= ki_.cwiseProduct(Vector(s.tail(n_)));
    VectorXd rate(s.size());
    rate.head(n_) = v;
    rate.segment(n_, n_) =
        law_.filter_gain().cwiseProduct(edot) - law_.filter_pole().cwiseProduct(nu);
    rate.segment(2 * n_, n_) =
        robot::forward_dynamics(arm_, q, v, tau - Vector(D_.cwiseProduct(edot)));
    if constexpr (requires { law_.weights(); }) {
      const auto [eps_1, eps_2] = law_.weights().of(n_);
      rate.tail(n_) =
          VectorXd(edot) + eps_1.cwiseProduct(VectorXd(e)) - eps_2.cwiseProduct(VectorXd(nu));
    }
    return rate;
  }

  [[nodiscard]] double V(double t_s, const VectorXd& s,
                         const LyapunovWeights& weights) const override {
    const messages::ReferencePoint r = trajectory_.at(t_s);
    const Vector q = s.head(n_), nu = s.segment(n_, n_), none = Vector::Zero(n_);
    const Vector e = q - r.q_ref, edot = Vector(s.segment(2 * n_, n_)) - r.v_ref;
    const VectorXd p = momentum(arm_, q, edot);
    const auto [eps_1, eps_2] = weights.of(n_);
    const VectorXd delta = eps_1.cwiseProduct(VectorXd(e)) - eps_2.cwiseProduct(VectorXd(nu));
    const Vector by_b = nu.cwiseQuotient(law_.filter_gain());
    double sum = (0.5 * VectorXd(edot) + delta).dot(p) -
                 0.5 * e.dot(law_.feedback(none, e, none, r)) -
                 0.5 * nu.dot(law_.feedback(none, none, by_b, r));
    if (ki_.size() > 0) sum += 0.5 * s.tail(n_).dot(ki_.cwiseProduct(Vector(s.tail(n_))));
    return sum;
  }

  [[nodiscard]] VectorXd from_units(const VectorXd& z) const override {
    const messages::ReferencePoint r = trajectory_.at(0);
    MatrixXd kp(n_, n_), kd_by_b(n_, n_);
    const Vector none = Vector::Zero(n_);
    for (Eigen::Index j = 0; j < n_; ++j) {
      const Vector unit = Vector::Unit(n_, j);
      kp.col(j) = -law_.feedback(none, unit, none, r);
      kd_by_b.col(j) = -law_.feedback(none, none, unit.cwiseQuotient(law_.filter_gain()), r);
    }
    VectorXd x(z.size());
    x << unscaled(kp, z.head(n_)), unscaled(kd_by_b, z.segment(n_, n_)),
        unscaled(robot::mass_matrix(arm_, r.q_ref), z.segment(2 * n_, n_)),
        z.tail(ki_.size()).cwiseQuotient(VectorXd(ki_).cwiseSqrt());
    return x;
  }

 private:
  L law_;
  robot::Model arm_;
  Vector D_, ki_;
};

/// Links behind springs: the law's theta_ref, J thetaddot = tau - K (theta - q).
class FlexibleLoop : public TrueLoop {
 public:
  explicit FlexibleLoop(const scenario::Scenario& scenario)
      : TrueLoop(scenario),
        law_(controller::make_law<LoriaOrtegaFlexible>(scenario)),
        arm_(controller::flexible_robot(scenario)),
        g_(controller::gains_of<LoriaOrtegaFlexible::Gains>(
            scenario, controller::law_facts(LoriaOrtegaFlexible::name))) {}

  [[nodiscard]] Eigen::Index errors() const override { return 2 * n_; }

  /// The state is (q, theta, nu1, nu2, v, thetadot). theta_ref and its rate do not depend on theta.
  [[nodiscard]] VectorXd state(double t_s, const VectorXd& x) const override {
    const messages::ReferencePoint r = trajectory_.at(t_s);
    VectorXd s = x;
    s.head(n_) += VectorXd(r.q_ref);
    s.segment(4 * n_, n_) += VectorXd(r.v_ref);
    const auto motor = motor_of(t_s, s);
    s.segment(n_, n_) += VectorXd(robot::value(motor.theta_ref));
    s.segment(5 * n_, n_) += VectorXd(robot::first_derivative(motor.theta_ref));
    return s;
  }

  [[nodiscard]] VectorXd derivative(double t_s, const VectorXd& s) const override {
    const messages::ReferencePoint r = trajectory_.at(t_s);
    const Vector q = s.head(n_), theta = s.segment(n_, n_), v = s.segment(4 * n_, n_);
    const auto motor = motor_of(t_s, s);
    const Vector spring = arm_.stiffness.cwiseProduct(theta - q);
    const Vector e2 = theta - robot::value(motor.theta_ref), nu2 = s.segment(3 * n_, n_);
    const Vector e2dot = Vector(s.segment(5 * n_, n_)) - robot::first_derivative(motor.theta_ref);
    const Vector tau = arm_.rotor_inertia.cwiseProduct(robot::second_derivative(motor.theta_ref)) +
                       robot::value(motor.torque) - g_.kp2.cwiseProduct(e2) -
                       g_.kd2.cwiseProduct(nu2);
    const Vector nu1 = s.segment(2 * n_, n_);
    VectorXd rate(s.size());
    rate << VectorXd(v), s.segment(5 * n_, n_),
        VectorXd(g_.b1.cwiseProduct(v - r.v_ref) - g_.a1.cwiseProduct(nu1)),
        VectorXd(g_.b2.cwiseProduct(e2dot) - g_.a2.cwiseProduct(nu2)),
        VectorXd(robot::forward_dynamics(arm_.links, q, v, spring)),
        VectorXd((tau - spring).cwiseQuotient(arm_.rotor_inertia));
    return rate;
  }

  [[nodiscard]] double V(double t_s, const VectorXd& s,
                         const LyapunovWeights& weights) const override {
    const messages::ReferencePoint r = trajectory_.at(t_s);
    const auto motor = motor_of(t_s, s);
    const Vector q = s.head(n_), e1 = q - r.q_ref;
    const Vector e2 = Vector(s.segment(n_, n_)) - robot::value(motor.theta_ref);
    const Vector nu1 = s.segment(2 * n_, n_), nu2 = s.segment(3 * n_, n_);
    const Vector edot_1 = Vector(s.segment(4 * n_, n_)) - r.v_ref;
    const Vector edot_2 = Vector(s.segment(5 * n_, n_)) - robot::first_derivative(motor.theta_ref);
    VectorXd e(2 * n_), nu(2 * n_), edot(2 * n_), p(2 * n_), kp(2 * n_), kd_by_b(2 * n_);
    e << VectorXd(e1), VectorXd(e2);
    nu << VectorXd(nu1), VectorXd(nu2);
    edot << VectorXd(edot_1), VectorXd(edot_2);
    p << VectorXd(momentum(arm_.links, q, edot_1)),
        VectorXd(arm_.rotor_inertia.cwiseProduct(edot_2));
    kp << VectorXd(g_.kp1), VectorXd(g_.kp2);
    kd_by_b << VectorXd(g_.kd1.cwiseQuotient(g_.b1)), VectorXd(g_.kd2.cwiseQuotient(g_.b2));
    const Vector twist = e1 - e2;
    const auto [eps_1, eps_2] = weights.of(2 * n_);
    return (0.5 * edot + eps_1.cwiseProduct(e) - eps_2.cwiseProduct(nu)).dot(p) +
           0.5 * e.dot(kp.cwiseProduct(e)) + 0.5 * nu.dot(kd_by_b.cwiseProduct(nu)) +
           0.5 * twist.dot(arm_.stiffness.cwiseProduct(twist));
  }

  [[nodiscard]] VectorXd from_units(const VectorXd& z) const override {
    const VectorXd K = arm_.stiffness;
    MatrixXd kp = MatrixXd::Zero(2 * n_, 2 * n_);
    kp.diagonal() << VectorXd(g_.kp1) + K, VectorXd(g_.kp2) + K;
    kp.topRightCorner(n_, n_).diagonal() = -K;
    kp.bottomLeftCorner(n_, n_).diagonal() = -K;
    VectorXd x(z.size());
    x << unscaled(kp, z.head(2 * n_)),
        z.segment(2 * n_, n_).cwiseProduct(VectorXd(g_.b1.cwiseQuotient(g_.kd1)).cwiseSqrt()),
        z.segment(3 * n_, n_).cwiseProduct(VectorXd(g_.b2.cwiseQuotient(g_.kd2)).cwiseSqrt()),
        unscaled(robot::mass_matrix(arm_.links, trajectory_.at(0).q_ref), z.segment(4 * n_, n_)),
        z.tail(n_).cwiseQuotient(VectorXd(arm_.rotor_inertia).cwiseSqrt());
    return x;
  }

 private:
  [[nodiscard]] LoriaOrtegaFlexible::MotorReference motor_of(double t_s, const VectorXd& s) const {
    return law_.motor_reference({s.head(n_), s.segment(4 * n_, n_), s.segment(n_, n_)},
                                trajectory_.at(t_s), s.segment(2 * n_, n_));
  }

  LoriaOrtegaFlexible law_;
  controller::law::FlexibleRobot arm_;
  LoriaOrtegaFlexible::Gains g_;
};

std::unique_ptr<TrueLoop> true_loop(const scenario::Scenario& scenario) {
  std::unique_ptr<TrueLoop> result;
  controller::with_law(scenario.controller.law, [&]<class L>(std::type_identity<L> /*law*/) {
    if constexpr (std::is_same_v<L, LoriaOrtegaFlexible>) {
      result = std::make_unique<FlexibleLoop>(scenario);
    } else if constexpr (requires(const L& law) { law.filter_pole(); }) {
      result = std::make_unique<RigidLoop<L>>(scenario);
    }
  });
  if (!result) throw std::logic_error("no certificate is about " + scenario.controller.law);
  return result;
}

/// Error of Vdot / V by the rounding of V in a difference over `TrueLoop::step_s`.
constexpr double rounding_per_s = 1e-8;

/// A state of the level set {V <= level}, by free numbers.
struct Candidate {
  double t_s = 0;
  VectorXd z;         ///< its direction
  double growth = 0;  ///< Vdot / V there [1/s]
};

/// The level set of one printed region over the run, and the search in it.
class LevelSet {
 public:
  LevelSet(const scenario::Scenario& scenario, const TrueLoop& loop, const CertifiedRegion& region,
           double level)
      : loop_(loop), weights_(region.weights), level_(level) {
    const reference::Motion motion(scenario, loop.trajectory());
    times_ = motion.closely();
    for (const double t_s : times_) {
      const Vector v = loop.trajectory().at(t_s).v_ref;
      speeds_.push_back(v.norm() + (speeds_.empty() ? 1e-9 : 0) + 1e-9);
    }
    reached_ = region.region.e_reached * std::sqrt(level / region.region.level);
  }

  /// Returns an instant: evenly over the motion, or the likelier the faster the reference is.
  double instant(std::mt19937_64& random) const {
    const std::size_t last = times_.size() - 1;
    std::uniform_int_distribution<std::size_t> evenly(0, last);
    std::discrete_distribution<std::size_t> by_speed(speeds_.begin(), speeds_.end());
    const std::size_t k = random() % 2 == 0 ? evenly(random) : by_speed(random);
    std::uniform_real_distribution<double> between(times_[k], times_[std::min(k + 1, last)]);
    return within(between(random));
  }
  double within(double t_s) const {
    return std::clamp(t_s, std::max(times_.front(), 1e-5), std::max(times_.back(), 1e-5));
  }

  /// Puts the candidate just below the level along its direction and computes its growth.
  void judge(Candidate& c) const {
    VectorXd s;
    double V = 0;
    for (int k = 0; k < 300; ++k) {
      s = loop_.state(c.t_s, loop_.from_units(c.z));
      V = loop_.V(c.t_s, s, weights_);
      if (!(V > 0)) throw std::runtime_error(fmt::format("V is {} J at {} s", V, c.t_s));
      // With a long way to go the inertia changes on it, and V is not the square of a length.
      if (V <= level_ && (V > 0.999 * level_ || k >= 10)) break;
      c.z *= std::min(std::sqrt(0.9999 * level_ / V), k < 10 ? infinity : 0.995);
    }
    ASSERT_LE(V, level_);
    c.growth = loop_.Vdot(c.t_s, s, weights_) / V;
  }

  [[nodiscard]] Candidate drawn(std::mt19937_64& random) const {
    std::normal_distribution<double> normal;
    Candidate c{instant(random), VectorXd(loop_.size()), 0};
    for (double& each : c.z) each = normal(random);
    c.z *= std::sqrt(2 * level_) / c.z.norm();
    judge(c);
    return c;
  }

  /// Returns directions of small errors at an instant in its columns, those in which V falls least
  /// the last ones. They are the eigenvectors of the forms that V and Vdot are there.
  [[nodiscard]] std::pair<MatrixXd, VectorXd> directions(double t_s) const {
    const Eigen::Index size = loop_.size();
    const double length = 1e-3 * std::sqrt(2 * level_);
    const auto forms = [&](const VectorXd& z) {
      const VectorXd s = loop_.state(t_s, loop_.from_units(length * z));
      return Eigen::Vector2d(loop_.V(t_s, s, weights_), loop_.Vdot(t_s, s, weights_));
    };
    std::vector<Eigen::Vector2d> alone(static_cast<std::size_t>(size));
    MatrixXd P(size, size), Q(size, size);
    for (Eigen::Index i = 0; i < size; ++i) {
      alone[static_cast<std::size_t>(i)] = forms(VectorXd::Unit(size, i));
      for (Eigen::Index j = 0; j < i; ++j) {
        const Eigen::Vector2d both = forms(VectorXd::Unit(size, i) + VectorXd::Unit(size, j)) -
                                     alone[static_cast<std::size_t>(i)] -
                                     alone[static_cast<std::size_t>(j)];
        P(i, j) = P(j, i) = both[0];
        Q(i, j) = Q(j, i) = both[1];
      }
      P(i, i) = 2 * alone[static_cast<std::size_t>(i)][0];
      Q(i, i) = 2 * alone[static_cast<std::size_t>(i)][1];
    }
    const numerics::SymmetricEigen eigen = testing::generalized_eigen(Q, P);
    return {eigen.vectors, eigen.values};
  }

  /// Returns the direction of small errors in which V falls least at an instant, on the level.
  [[nodiscard]] Candidate slowest(double t_s) const {
    Candidate c{t_s, directions(t_s).first.rightCols<1>(), 0};
    c.z *= std::sqrt(2 * level_) / c.z.norm();
    judge(c);
    return c;
  }

  /// Returns where an ascent along the gradient of Vdot / V ends. Coordinates are scaled so that a
  /// change in each direction of small errors costs about the same growth.
  [[nodiscard]] Candidate climbed(Candidate c, int steps, std::size_t& points) const {
    auto [basis, rates] = directions(c.t_s);
    const double largest = rates.maxCoeff(), spread = largest - rates.minCoeff();
    for (Eigen::Index i = 0; i < rates.size(); ++i) {
      basis.col(i) *=
          c.z.norm() / basis.col(i).norm() / std::sqrt(1 + (largest - rates[i]) / (1e-4 * spread));
    }
    double step = 0.05;
    for (int k = 0; k < steps; ++k) {
      const auto moved = [&](const VectorXd& by) {
        Candidate other = c;
        other.z += basis * by.head(by.size() - 1);
        other.t_s = within(c.t_s + by[by.size() - 1] * span_s());
        judge(other);
        ++points;
        return other;
      };
      constexpr double width = 1e-3;
      VectorXd gradient(c.z.size() + 1);
      for (Eigen::Index i = 0; i < gradient.size(); ++i) {
        const VectorXd by = width * VectorXd::Unit(gradient.size(), i);
        gradient[i] = moved(by).growth - moved(-by).growth;
      }
      if (!(gradient.norm() > 0)) break;
      gradient.normalize();
      Candidate next = moved(step * gradient);
      while (!(next.growth > c.growth) && step > 1e-6) {
        step /= 3;
        next = moved(step * gradient);
      }
      if (!(next.growth > c.growth)) break;
      step = std::min(3 * step, 1.0);
      c = next;
    }
    return c;
  }

  /// Returns the errors of a candidate as shares of the errors that the region says are reached.
  [[nodiscard]] double reach(const Candidate& c) const {
    const VectorXd x = loop_.from_units(c.z);
    return x.head(reached_.size()).cwiseAbs().cwiseQuotient(reached_).maxCoeff();
  }

 private:
  [[nodiscard]] double span_s() const { return 0.1 * (times_.back() - times_.front()); }

  const TrueLoop& loop_;
  LyapunovWeights weights_;
  double level_;
  VectorXd reached_;
  std::vector<double> times_, speeds_;
};

/// Random states on a level and ascents from the worst of them.
struct Search {
  std::size_t points = 0;
  double random = -infinity;  ///< largest Vdot / V of random states [1/s]
  double growth = -infinity;  ///< the same after the ascents
  double reach = 0;           ///< largest |e_i| over what the region says is reached
};

/// Returns the count of random states for each region.
std::size_t states() {
  const char* const given = std::getenv("TACHLESS_MONTE_CARLO");
  return given != nullptr ? std::stoul(given) : 300;
}

Search search(const LevelSet& set, std::uint64_t seed) {
  const std::size_t count = states(), ascents = std::max<std::size_t>(3, count / 200);
  const int steps = count > 1000 ? 150 : 30;
  std::vector<Candidate> all(count);
  base::parallel_for(count, [&](std::size_t i) {
    std::mt19937_64 random(seed * 1000003 + i);
    all[i] = set.drawn(random);
  });
  Search result;
  result.points = count;
  for (const Candidate& each : all) result.reach = std::max(result.reach, set.reach(each));
  std::ranges::sort(all, std::greater(), &Candidate::growth);
  result.random = all[0].growth;
  all.resize(2 * ascents);
  std::vector<std::size_t> points(all.size(), 0);
  base::parallel_for(all.size(), [&](std::size_t i) {
    if (i % 2 == 1) all[i] = set.slowest(all[i].t_s);
    all[i] = set.climbed(all[i], steps, points[i]);
  });
  for (std::size_t i = 0; i < all.size(); ++i) {
    result.points += points[i];
    result.growth = std::max(result.growth, all[i].growth);
    result.reach = std::max(result.reach, set.reach(all[i]));
  }
  return result;
}

void expect_decay(const std::string& name, const scenario::Scenario& scenario,
                  const certify::Certificate& found) {
  const std::unique_ptr<TrueLoop> loop = true_loop(scenario);
  const auto look = [&](const char* which, const std::optional<CertifiedRegion>& region) {
    if (!region || !std::isfinite(region->region.level)) return;
    const std::string where = name + ", " + which;
    const double level = region->region.level;
    for (const double part : {1.0, 1e-6}) {
      const Search worst = search(LevelSet(scenario, *loop, *region, part * level), 1);
      std::cout << fmt::format(
          "{}, V = {:.4g} J: {} states, largest Vdot/V {:.5g} of random ones, {:.5g} 1/s after "
          "ascents; rate {:.5g}\n",
          where, part * level, worst.points, worst.random, worst.growth, region->rate);
      // With an integral V stands still where all errors but that of the integral are 0.
      const bool integral = loop->size() > 3 * loop->errors();
      EXPECT_LT(worst.growth, integral ? rounding_per_s : 0)
          << where << " at " << part << " of the level";
      EXPECT_LE(worst.reach, 1 + 1e-9) << where << " at " << part << " of the level";
      EXPECT_TRUE(region->rate > 0 || found.stability->own_weights) << where;
      // The rate is that of small errors. Sampled postures may miss the slowest by a little.
      if (part < 1 && region->rate > 0) {
        EXPECT_LE(worst.growth,
                  rounding_per_s - (found.stability->proved ? 1 - 1e-6 : 0.99) * region->rate)
            << where;
      }
    }
    // Each joint alone, from rest as far as printed, and as fast as printed.
    // Sampled postures may miss the largest inertia by a little.
    const double inside = (1 + (found.stability->proved ? 1e-9 : 1e-5)) * level;
    const Eigen::Index N = loop->errors();
    for (Eigen::Index i = 0; i < region->region.e_at_rest.size(); ++i) {
      VectorXd x = VectorXd::Zero(loop->size());
      x[i] = region->region.e_at_rest[i];
      if (i < found.start_range.size()) x[i] = std::min(x[i], found.start_range[i]);
      EXPECT_LE(loop->V(0, loop->state(0, x), region->weights), inside) << where << i;
      x.setZero();
      x[2 * N + i] = region->region.edot[i];
      EXPECT_LE(loop->V(0, loop->state(0, x), region->weights), inside) << where << i;
    }
  };
  look("fastest", found.stability->fastest);
  look("largest", found.stability->largest);
}

/// Continuous time has no lead of the feed-forward.
std::vector<std::string> continuous(const std::string& law, std::vector<std::string> overrides) {
  if (law != "loria_ortega_flexible") overrides.emplace_back("controller.feedforward_lead=none");
  return overrides;
}

void expect_decay_of(const std::string& name, const scenario::Scenario& scenario) {
  const certify::Certificate found = certify::certify(scenario);
  if (!found.stability) {
    std::cout << name << ": no region, " << found.no_stability << '\n';
    return;
  }
  expect_decay(name, scenario, found);
}

struct Shipped {
  std::string name;
  std::vector<std::string> overrides = {};
};

scenario::Scenario load(const Shipped& s) {
  return shipped(s.name, continuous(shipped(s.name, s.overrides).controller.law, s.overrides));
}

const std::string integral =
    "controller.gains={kp: [40000, 2400], kd: [1000, 60], a: [1000, 1000], b: [1000, 1000], ki: "
    "[10000, 600], eps_1: 25, eps_2: 0.125}";

TEST(InsideTheRegion, VFallsEverywhereInShippedScenarios) {
  std::vector<Shipped> all = {
      {"practical_rigid"},
      {"practical_flexible"},
      {"paper_rigid"},
      {"practical_rigid", {"controller.law=loria_ortega_integral", integral}},
      {"iiwa_point_to_point"}};
  if (std::getenv("TACHLESS_MONTE_CARLO") != nullptr) {
    for (const char* name :
         {"paper_rigid_offset", "paper_flexible", "iiwa_flexible", "panda", "ur5e", "xarm7",
          "study_attraction", "study_delay", "study_encoder", "study_flexibility", "study_payload",
          "regulation", "flexible_regulation"}) {
      all.push_back({name});
    }
  }
  for (const Shipped& each : all) expect_decay_of(each.name, load(each));
}

TEST(InsideTheRegion, VFallsEverywhereInCases) {
  const std::string folder = TACHLESS_SOURCE_DIR "/tests/analysis/certify/cases/";
  const std::array cases = {
      std::pair("burst_between_instants", "controller.gains.w=30"),
      std::pair("prismatic_region", "loop.period_s=2e-4"),  // stable there
  };
  for (const auto& [name, change] : cases) {
    expect_decay_of(name, scenario::load_scenario(folder + name + ".yaml",
                                                  {change, "controller.feedforward_lead=none"}));
  }
}

/// Gains by `design`, of the law with diagonal, matrix and scheduled gains.
TEST(InsideTheRegion, VFallsEverywhereOfDesignedArms) {
  std::vector<Shipped> all = {{"practical_rigid", {"controller.law=loria_ortega_rigid"}}};
  if (std::getenv("TACHLESS_MONTE_CARLO") != nullptr) {
    all = {};
    for (const char* const name : {"practical_rigid", "ur5e", "xarm7"}) {
      for (const char* const gains : {"law=loria_ortega_rigid", "law=loria_ortega_scheduled"}) {
        all.push_back({name, {std::string("controller.") + gains}});
      }
    }
  }
  for (Shipped& each : all) {
    const scenario::Scenario asked = shipped(
        each.name, {each.overrides[0], each.overrides[0].find("scheduled") != std::string::npos
                                           ? "controller.gains={w: 10, damping: 1, a: 100, b: 100}"
                                           : "controller.gains={kp: 10, kd: 1, a: 100, b: 100}"});
    const design::Design made = design::design(asked, {});
    each.overrides = design::overrides_of(made, asked.controller.law);
    expect_decay_of(each.name + " designed, " + asked.controller.law, load(each));
  }
}

}  // namespace
}  // namespace tachless::lyapunov::inside_region_test
