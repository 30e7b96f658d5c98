// The error equations of flexible_position, flexible_motor and loria_ortega_adaptive.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <utility>

#include "controller/laws.h"
#include "controller/registry.h"
#include "lyapunov/law_loop.h"
#include "lyapunov/weighted_region.h"
#include "numerics/postures.h"
#include "plant/plant_model.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"

namespace tachless::lyapunov {
namespace {

using controller::law::FlexibleMotor;
using controller::law::FlexiblePosition;
using controller::law::LoriaOrtegaAdaptive;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using messages::ReferencePoint;

/// Postures and instants of a scenario, in the order of evenly spread sequences.
class Samples {
 public:
  explicit Samples(const scenario::Scenario& scenario)
      : links(error_model(scenario)),
        start_(scenario.plant.initial.position_rad),
        trajectory_(reference::make_trajectory(scenario)) {
    instants_ = reference::Motion(scenario, trajectory_).closely(257, 4096);
  }

  /// Returns a posture; number 0 is the scenario's start.
  [[nodiscard]] Vector posture(int k) const {
    return k == 0 ? start_ : numerics::spread_posture(links, k);
  }
  /// Returns a posture that has nothing to do with the first: of what is taken anywhere between q
  /// and q_ref.
  [[nodiscard]] Vector other_posture(int k) const {
    return numerics::spread_posture(links, 7 * k + 4099);
  }
  [[nodiscard]] ReferencePoint instant(int k) const {
    const double turn = 0.6180339887498949 * k;
    const auto count = static_cast<double>(instants_.size());
    return trajectory_.at(instants_[static_cast<std::size_t>((turn - std::floor(turn)) * count)]);
  }
  [[nodiscard]] ReferencePoint first() const { return trajectory_.at(0); }

  /// Returns a form with M, Cd and C at posture k, and the rest to be filled in.
  [[nodiscard]] ErrorForm at(int k, Index size) const {
    const Vector q = posture(k);
    const numerics::Inertia inertia = numerics::inertia_at(links, q);
    const Index n = q.size();
    return {MatrixXd::Zero(size, size),
            MatrixXd::Zero(size, n),
            MatrixXd::Zero(n, size),
            inertia.M,
            robot::coriolis_matrix(links, q, instant(k).v_ref),
            VectorXd::Zero(n),
            inertia.C};
  }

  robot::Model links;

 private:
  Vector start_;
  reference::Trajectory trajectory_;
  std::vector<double> instants_;
};

using JetTriple = std::array<Vector, 3>;  ///< of q, v and a

/// Returns the first and the second derivative of ID along `d`.
std::pair<Vector, Vector> along(const robot::Model& model, const JetTriple& at,
                                const JetTriple& d) {
  const Vector none = Vector::Zero(at[0].size());
  const robot::JetVector torque =
      robot::inverse_dynamics(model, robot::jet(at[0], d[0], none), robot::jet(at[1], d[1], none),
                              robot::jet(at[2], d[2], none));
  return {robot::first_derivative(torque), robot::second_derivative(torque)};
}

/// Returns d ID(q, v_ref, a_ref) / dq, exact to rounding.
MatrixXd torque_gradient(const robot::Model& model, const Vector& q, const ReferencePoint& r) {
  const Index n = q.size();
  const Vector none = Vector::Zero(n);
  MatrixXd G(n, n);
  for (Index j = 0; j < n; ++j) {
    G.col(j) = along(model, {q, r.v_ref, r.a_ref}, {Vector::Unit(n, j), none, none}).first;
  }
  return G;
}

/// Returns dR/dq, R the rate of ID at a posture that moves with v_ref, by polarisation.
MatrixXd torque_rate_gradient(const robot::Model& model, const Vector& q, const ReferencePoint& r) {
  const Index n = q.size();
  MatrixXd result(n, n);
  for (Index j = 0; j < n; ++j) {
    const auto second = [&](double sign) {
      return along(model, {q, r.v_ref, r.a_ref},
                   {Vector(r.v_ref + sign * Vector::Unit(n, j)), r.a_ref, r.jerk_ref})
          .second;
    };
    result.col(j) = 0.25 * (second(1) - second(-1));
  }
  return result;
}

/// Parts of a state vector y, n entries each.
class Blocks {
 public:
  explicit Blocks(Index n) : n_(n) {}
  [[nodiscard]] auto block(MatrixXd& A, Index row, Index column) const {
    return A.block(row * n_, column * n_, n_, n_);
  }

 private:
  Index n_;
};

MatrixXd diagonal(const VectorXd& x) { return x.asDiagonal(); }

/// Bounds over every posture and instant.
struct Bounds {
  TorqueGradients gradients;
  MatrixXd v_scale;  ///< as of `BoundedForm`
};

/// Returns the bounds for a constant reference and for sums of sines; nothing where they are not
/// known at every posture and instant.
std::optional<Bounds> bounds_of(const scenario::Scenario& scenario, const robot::Model& links) {
  if (reference::composition_of(scenario.reference).sines.empty()) {
    const reference::Trajectory trajectory = reference::make_trajectory(scenario);
    if (reference::Motion(scenario, trajectory).moves()) return {};
  }
  const MotionBound motion = motion_bound(scenario);
  const auto gradients = torque_gradients(links, motion.v, motion.a, motion.jerk);
  if (!gradients) return {};
  return Bounds{*gradients, velocity_bound(scenario).scale};
}

/// Viscous damping of a flexible robot [N m s/rad]. The laws do not know of it: its torque on the
/// errors is in the loop, its torque on the reference is not.
struct Damping {
  VectorXd links, motors, springs;

  explicit Damping(const scenario::Scenario& scenario)
      : links(scenario.plant.drive.viscous_friction_Nms_per_rad),
        motors(scenario.robot.flexible->motor_damping),
        springs(scenario.robot.flexible->spring_damping) {}

  /// Adds the torques to the loop whose block `w` of y is the rate of the motors' errors.
  void add(ErrorForm& f, const Blocks& y, Index w, const VectorXd& rotor_inertia) const {
    f.damping = links + springs;
    y.block(f.Gam, 0, w) += diagonal(springs);
    y.block(f.Fy, w, w) -= diagonal((motors + springs).cwiseQuotient(rotor_inertia));
    y.block(f.Fe, w, 0) += diagonal(springs.cwiseQuotient(rotor_inertia));
  }
};

/// y = (e1, nu1, z, w, nu2), z = ts - t1 the error of the springs' torque, w = thetadot -
/// thetadot_d.
class PositionLoop : public FormLoop {
 public:
  explicit PositionLoop(const scenario::Scenario& scenario)
      : samples_(scenario),
        robot_(controller::flexible_robot(scenario)),
        law_(controller::make_law<FlexiblePosition>(scenario)),
        gains_(controller::gains_of<FlexiblePosition::Gains>(
            scenario, controller::law_facts(FlexiblePosition::name))),
        damping_(scenario),
        bounds_(bounds_of(scenario, robot_.links)) {
    const plant::ArmState start =
        plant::initial_state(scenario.plant, scenario.robot.flexible, robot_.links);
    const ReferencePoint r = samples_.first();
    const messages::BothPositionsMeasurement measured{start.q, start.theta};
    const auto signals = law_.step(law_.start(measured, r), measured, r).signals;
    const Vector z =
        robot_.spring_torque(start.q, start.theta) -
        law_.link_torque(start.q, {r.v_ref, r.a_ref}, signals.value[0], signals.value[1]);
    initial_.resize(6 * start.q.size());
    initial_ << signals.value[0], signals.value[1], z,
        start.thetadot - robot::first_derivative(law_.motor_reference(r)), signals.value[3],
        start.v - r.v_ref;
  }

  [[nodiscard]] ErrorForm form(int k) const override {
    const ReferencePoint r = samples_.instant(k);
    const Blocks y(robot_.links.num_joints);
    ErrorForm f = with_gains(samples_.at(k, 5 * robot_.links.num_joints));
    y.block(f.Fy, 2, 0) -= torque_rate_gradient(robot_.links, samples_.other_posture(k), r);
    y.block(f.Fe, 2, 0) -= torque_gradient(robot_.links, samples_.posture(k), r);
    return f;
  }

  [[nodiscard]] std::optional<BoundedForm> bounded() const override {
    if (!bounds_) return {};
    const Index n = robot_.links.num_joints;
    BoundedForm all{with_gains(samples_.at(0, 5 * n)), MatrixXd::Zero(5 * n, n),
                    MatrixXd::Zero(n, n), MatrixXd::Zero(n, 6 * n), bounds_->v_scale};
    all.E.middleRows(2 * n, n).setIdentity();
    all.most.leftCols(n) = bounds_->gradients.of_rate;
    all.most.rightCols(n) = bounds_->gradients.of_torque;
    return all;
  }

  /// Returns `f` with all that does not depend on posture and reference.
  [[nodiscard]] ErrorForm with_gains(ErrorForm f) const {
    const Index n = robot_.links.num_joints;
    const FlexiblePosition::Gains& g = gains_;
    const VectorXd Jb = robot_.rotor_inertia.cwiseQuotient(g.beta);
    const MatrixXd one = MatrixXd::Identity(n, n);
    const Blocks y(n);
    y.block(f.Fy, 1, 1) = -diagonal(g.a1);
    y.block(f.Fy, 2, 1) = -diagonal(g.kd1.cwiseProduct(g.a1));
    y.block(f.Fy, 2, 3) = diagonal(robot_.stiffness);
    y.block(f.Fy, 3, 2) = -diagonal(Jb.cwiseInverse());
    y.block(f.Fy, 3, 4) = -diagonal(g.kd2.cwiseQuotient(robot_.rotor_inertia));
    y.block(f.Fy, 4, 3) = diagonal(g.b2);
    y.block(f.Fy, 4, 4) = -diagonal(g.a2);
    y.block(f.Fe, 0, 0) = one;
    y.block(f.Fe, 1, 0) = diagonal(g.b1);
    y.block(f.Fe, 2, 0) = diagonal(g.kp1 + g.kd1.cwiseProduct(g.b1) - robot_.stiffness);
    y.block(f.Gam, 0, 0) = -diagonal(g.kp1);
    y.block(f.Gam, 0, 1) = -diagonal(g.kd1);
    y.block(f.Gam, 0, 2) = one;
    damping_.add(f, y, 3, robot_.rotor_inertia);
    return f;
  }

  [[nodiscard]] VectorXd displaced(const VectorXd& e) const override {
    const Index n = e.size();
    const ReferencePoint r = samples_.first();
    const auto torque = [&](const Vector& q) {
      return robot::inverse_dynamics(robot_.links, q, r.v_ref, r.a_ref);
    };
    VectorXd y = VectorXd::Zero(5 * n);
    y.head(n) = e;
    y.segment(2 * n, n) = gains_.kp1.cwiseProduct(e) - torque(r.q_ref + e) + torque(r.q_ref);
    return y;
  }

  [[nodiscard]] VectorXd initial() const override { return initial_; }

  [[nodiscard]] VectorXd size() const override {
    const FlexiblePosition::Gains& g = gains_;
    VectorXd all(5 * g.kp1.size());
    all << g.kp1, g.kd1.cwiseQuotient(g.b1), robot_.stiffness.cwiseInverse(),
        robot_.rotor_inertia.cwiseQuotient(g.beta), g.kd2.cwiseQuotient(g.beta.cwiseProduct(g.b2));
    return all;
  }

 private:
  Samples samples_;
  controller::law::FlexibleRobot robot_;
  FlexiblePosition law_;
  FlexiblePosition::Gains gains_;
  Damping damping_;
  std::optional<Bounds> bounds_;
  VectorXd initial_;
};

/// y = (e1, em, w, nu): the links' error, the motors' error, its rate and its filter.
class MotorLoop : public FormLoop {
 public:
  explicit MotorLoop(const scenario::Scenario& scenario)
      : samples_(scenario),
        robot_(controller::flexible_robot(scenario)),
        gains_(controller::gains_of<FlexibleMotor::Gains>(
            scenario, controller::law_facts(FlexibleMotor::name))),
        damping_(scenario),
        bounds_(bounds_of(scenario, robot_.links)) {
    const auto law = controller::make_law<FlexibleMotor>(scenario);
    const plant::ArmState start =
        plant::initial_state(scenario.plant, scenario.robot.flexible, robot_.links);
    const ReferencePoint r = samples_.first();
    const messages::MotorPositionMeasurement measured{start.theta};
    const auto signals = law.step(law.start(measured, r), measured, r).signals;
    initial_.resize(5 * start.q.size());
    initial_ << start.q - r.q_ref, signals.value[0],
        start.thetadot - robot::first_derivative(law.motor_reference(r).theta_d), signals.value[1],
        start.v - r.v_ref;
  }

  [[nodiscard]] ErrorForm form(int k) const override {
    const Index n = robot_.links.num_joints;
    ErrorForm f = with_gains(samples_.at(k, 4 * n));
    f.Gam.leftCols(n) -=
        torque_gradient(robot_.links, samples_.other_posture(k), samples_.instant(k));
    return f;
  }

  [[nodiscard]] std::optional<BoundedForm> bounded() const override {
    if (!bounds_) return {};
    const Index n = robot_.links.num_joints;
    BoundedForm all{with_gains(samples_.at(0, 4 * n)), MatrixXd::Zero(4 * n, n),
                    MatrixXd::Identity(n, n), MatrixXd::Zero(n, 5 * n), bounds_->v_scale};
    all.most.leftCols(n) = bounds_->gradients.of_torque;
    return all;
  }

  /// Returns `f` with all that does not depend on posture and reference.
  [[nodiscard]] ErrorForm with_gains(ErrorForm f) const {
    const Index n = robot_.links.num_joints;
    const MatrixXd one = MatrixXd::Identity(n, n), K = robot_.stiffness.asDiagonal();
    const MatrixXd by_J = robot_.rotor_inertia.cwiseInverse().asDiagonal();
    const Blocks y(n);
    y.block(f.Fy, 1, 2) = one;
    y.block(f.Fy, 2, 0) = by_J * K;
    y.block(f.Fy, 2, 1) = -by_J * (K + diagonal(gains_.kp));
    y.block(f.Fy, 2, 3) = -by_J * diagonal(gains_.kd);
    y.block(f.Fy, 3, 2) = diagonal(gains_.b);
    y.block(f.Fy, 3, 3) = -diagonal(gains_.a);
    y.block(f.Fe, 0, 0) = one;
    y.block(f.Gam, 0, 0) = -K;
    y.block(f.Gam, 0, 1) = K;
    damping_.add(f, y, 2, robot_.rotor_inertia);
    return f;
  }

  [[nodiscard]] VectorXd displaced(const VectorXd& e) const override {
    VectorXd y = VectorXd::Zero(4 * e.size());
    y << e, e, VectorXd::Zero(2 * e.size());
    return y;
  }
  [[nodiscard]] VectorXd initial() const override { return initial_; }

  [[nodiscard]] VectorXd size() const override {
    VectorXd all(4 * gains_.kp.size());
    all << robot_.stiffness, robot_.stiffness + gains_.kp, robot_.rotor_inertia,
        gains_.kd.cwiseQuotient(gains_.b);
    return all;
  }

 private:
  Samples samples_;
  controller::law::FlexibleRobot robot_;
  FlexibleMotor::Gains gains_;
  Damping damping_;
  std::optional<Bounds> bounds_;
  VectorXd initial_;
};

/// y = (e, nu). The robot is that of a corner of the box of the unknown parameters: each of the
/// load's parameters and of the frictions is at one end of its range.
class AdaptiveLoop : public FormLoop {
 public:
  static constexpr int most_corners = 64;

  explicit AdaptiveLoop(const scenario::Scenario& scenario)
      : samples_(scenario),
        law_(controller::make_law<LoriaOrtegaAdaptive>(scenario)),
        damping_(scenario.plant.drive.viscous_friction_Nms_per_rad) {
    const auto& given = scenario.plant.initial;
    const ReferencePoint r = samples_.first();
    const messages::PositionMeasurement measured{given.position_rad};
    const auto signals = law_.step(law_.start(measured, r), measured, r).signals;
    initial_.resize(3 * r.q_ref.size());
    initial_ << signals.value[0], signals.value[1], given.velocity_rad_per_s - r.v_ref;
    for (Index i = 0; i < damping_.size(); ++i) {
      if (gains().gamma_friction[i] > 0) unknown_friction_.push_back(i);
    }
  }

  [[nodiscard]] bool follows() const { return law_.follows(); }
  [[nodiscard]] int corners() const override {
    const std::size_t unknown = law_.columns().size() + unknown_friction_.size();
    return unknown > 20 ? 1 << 20 : 1 << unknown;
  }

  [[nodiscard]] ErrorForm form(int k) const override {
    const int corner = k % corners(), sample = k / corners();
    const ReferencePoint r = samples_.instant(sample);
    const Vector q = samples_.posture(sample), other = samples_.other_posture(sample);
    const Index n = q.size();
    ErrorForm f = samples_.at(sample, 2 * n);
    MatrixXd H = MatrixXd::Zero(n, n);
    int bit = 0;
    for (const LoriaOrtegaAdaptive::Column& column : law_.columns()) {
      const double value = column.box[static_cast<std::size_t>(corner >> bit++ & 1)];
      const double each = column.load.size() > 1 ? value / 2 : value;
      double sign = 1;
      for (const robot::Model& load : column.load) {
        add(f, load, q, r, sign * each);
        H += sign * each * torque_gradient(load, other, r);
        sign = -1;
      }
    }
    f.damping = damping_;
    for (const Index i : unknown_friction_) {
      f.damping[i] = (corner >> bit++ & 1) != 0 ? gains().friction_max[i] : 0;
    }
    const Blocks y(n);
    y.block(f.Fy, 1, 1) = -diagonal(gains().a);
    y.block(f.Fe, 0, 0) = MatrixXd::Identity(n, n);
    y.block(f.Fe, 1, 0) = diagonal(gains().b);
    y.block(f.Gam, 0, 0) = -diagonal(gains().kp) - H;
    y.block(f.Gam, 0, 1) = -diagonal(gains().kd);
    return f;
  }

  [[nodiscard]] VectorXd displaced(const VectorXd& e) const override {
    VectorXd y(2 * e.size());
    y << e, VectorXd::Zero(e.size());
    return y;
  }
  [[nodiscard]] VectorXd initial() const override { return initial_; }

  [[nodiscard]] VectorXd size() const override {
    VectorXd all(2 * damping_.size());
    all << gains().kp, gains().kd.cwiseQuotient(gains().b);
    return all;
  }

  [[nodiscard]] std::optional<FormWeights> weights() const override {
    const Index n = damping_.size();
    MatrixXd N(n, 2 * n);
    N << gains().eps_1 * MatrixXd::Identity(n, n), -gains().eps_2 * MatrixXd::Identity(n, n);
    return FormWeights{diagonal(size()), N};
  }

  /// The estimates begin at zero: 1/2 sum |pi|^2 / gamma at the farthest corner.
  [[nodiscard]] std::optional<double> of_parameters() const override {
    double sum = 0;
    for (const LoriaOrtegaAdaptive::Column& column : law_.columns()) {
      sum += 0.5 * column.box[1] * column.box[1] / column.rate;
    }
    for (const Index i : unknown_friction_) {
      sum += 0.5 * gains().friction_max[i] * gains().friction_max[i] / gains().gamma_friction[i];
    }
    return sum;
  }

 private:
  [[nodiscard]] const LoriaOrtegaAdaptive::Gains& gains() const { return law_.gains(); }

  /// Adds `times` the inertia of a load.
  static void add(ErrorForm& f, const robot::Model& load, const Vector& q, const ReferencePoint& r,
                  double times) {
    const numerics::Inertia of_load = numerics::inertia_at(load, q);
    f.M += times * of_load.M;
    f.Cd += times * robot::coriolis_matrix(load, q, r.v_ref);
    for (std::size_t j = 0; j < f.C.size(); ++j) f.C[j] += times * of_load.C[j];
  }

  Samples samples_;
  LoriaOrtegaAdaptive law_;
  VectorXd damping_;
  std::vector<Index> unknown_friction_;
  VectorXd initial_;
};

}  // namespace

bool has_error_form(std::string_view law) {
  return law == FlexiblePosition::name || law == FlexibleMotor::name ||
         law == LoriaOrtegaAdaptive::name;
}

std::unique_ptr<FormLoop> form_loop(const scenario::Scenario& scenario, std::string& why_not) {
  const std::string& law = scenario.controller.law;
  if (law == FlexiblePosition::name) return std::make_unique<PositionLoop>(scenario);
  if (law == FlexibleMotor::name) return std::make_unique<MotorLoop>(scenario);
  if (scenario.robot.flexible) {
    why_not = fmt::format("{} assumes rigid joints, but this robot's are flexible", law);
    return {};
  }
  auto loop = std::make_unique<AdaptiveLoop>(scenario);
  if (loop->follows()) {
    why_not = fmt::format(
        "the region of {} is computed for constant gains, and w lets them follow the reference; "
        "give kp and kd in place of w and damping",
        law);
    return {};
  }
  if (loop->corners() > AdaptiveLoop::most_corners) {
    why_not = fmt::format(
        "the box of the unknown parameters has more than {} corners; make fewer parameters unknown",
        AdaptiveLoop::most_corners);
    return {};
  }
  return loop;
}

}  // namespace tachless::lyapunov
