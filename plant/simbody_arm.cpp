#include <SimTKsimbody.h>

#include <SimTKcommon/internal/SystemGuts.h>
#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <stdexcept>
#include <utility>
#include <vector>

#include "plant/arm_mechanics.h"

namespace tachless::plant {
namespace {

SimTK::Vec3 vec3(const Eigen::Vector3d& x) { return {x.x(), x.y(), x.z()}; }

SimTK::Rotation rotation(const Eigen::Matrix3d& R) {
  return SimTK::Rotation(
      SimTK::Mat33(R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)),
      true);
}

/// Simbody keeps inertia as (mass, inertia / mass) and so loses the inertia of a massless body. A
/// power of two far below every rounding error stands in for its mass and scales exactly.
SimTK::MassProperties mass_properties(const robot::Body& body) {
  constexpr double stand_in = 0x1p-200;
  const double mass = body.mass > 0 ? body.mass : stand_in;
  const Eigen::Vector3d com = body.mass > 0 ? body.p_Bcm : Eigen::Vector3d(0, 0, 0);
  const Eigen::Matrix3d I =
      body.I_Bcm / mass + com.squaredNorm() * Eigen::Matrix3d::Identity() - com * com.transpose();
  return {mass, vec3(com),
          SimTK::UnitInertia(SimTK::Vec3(I(0, 0), I(1, 1), I(2, 2)),
                             SimTK::Vec3(I(1, 0), I(2, 0), I(2, 1)))};
}

/// The tree of bodies in Simbody, and its mechanics in independent coordinates: with
/// q_tree = G q + offset (G has one entry per row), M = G' M_tree G and bias = G' bias_tree.
/// Eliminating mimic joints by G instead of Simbody's coupler constraints leaves an ODE: no
/// constraint drift, no projection, and a sixth of the cost
/// (docs/decisions/0003-plant-integration).
class Tree {
 public:
  explicit Tree(const robot::Model& model)
      : num_joints_(model.num_joints), matter_(system_), gravity_(vec3(model.gravity)) {
    for (const robot::Body& body : model.bodies) {
      // Simbody pins turn about z and sliders move along x of the mobilizer's frames F and M.
      const bool revolute = body.type == robot::JointType::revolute;
      const Eigen::Vector3d along = revolute ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitX();
      const SimTK::Rotation R_BM =
          rotation(Eigen::Quaterniond::FromTwoVectors(along, body.axis_B).toRotationMatrix());
      const SimTK::Transform X_PF(rotation(body.R_PB) * R_BM, vec3(body.p_PB));
      const SimTK::Transform X_BM(R_BM, SimTK::Vec3(0));
      // Body i of the model is mobilized body i + 1: the ground is number 0.
      SimTK::MobilizedBody& parent =
          matter_.updMobilizedBody(SimTK::MobilizedBodyIndex(body.parent + 1));
      const SimTK::Body::Rigid rigid(mass_properties(body));
      if (revolute) {
        SimTK::MobilizedBody::Pin(parent, X_PF, rigid, X_BM);
      } else {
        SimTK::MobilizedBody::Slider(parent, X_PF, rigid, X_BM);
      }
    }
    state_ = system_.realizeTopology();
    system_.realizeModel(state_);
    for (std::size_t i = 0; i < model.bodies.size(); ++i) {
      const robot::Body& body = model.bodies[i];
      const SimTK::MobilizedBodyIndex index(static_cast<int>(i) + 1);
      const SimTK::MobilizedBody& mobilized = matter_.getMobilizedBody(index);
      joints_.push_back({mobilized.getFirstQIndex(state_), mobilized.getFirstUIndex(state_),
                         body.coordinate, body.multiplier, body.offset});
      if (body.mass > 0) masses_.push_back({index, vec3(body.p_Bcm), body.mass * gravity_});
    }
    weights_.resize(matter_.getNumBodies());
    column_.resize(state_.getNU());
    no_forces_.resize(state_.getNU());
    no_forces_.setToZero();
    M.resize(num_joints_, num_joints_);
    bias.resize(num_joints_);
  }

  /// Sets M and bias.
  void evaluate(const double* q, const double* v) {
    SimTK::Vector& q_tree = state_.updQ();
    SimTK::Vector& v_tree = state_.updU();
    for (const Joint& joint : joints_) {
      q_tree[joint.q] = joint.multiplier * q[joint.coordinate] + joint.offset;
      v_tree[joint.u] = joint.multiplier * v[joint.coordinate];
    }
    system_.realize(state_, SimTK::Stage::Velocity);

    weights_.setToZero();
    for (const Mass& mass : masses_) {
      matter_.addInStationForce(state_, mass.body, mass.com, mass.weight, weights_);
    }
    matter_.calcResidualForceIgnoringConstraints(state_, no_forces_, weights_, no_accelerations_,
                                                 residual_);
    bias.setZero();
    for (const Joint& joint : joints_) {
      bias[joint.coordinate] += joint.multiplier * residual_[joint.u];
    }

    M.setZero();
    for (int j = 0; j < num_joints_; ++j) {
      column_.setToZero();
      for (const Joint& joint : joints_) {
        if (joint.coordinate == j) column_[joint.u] = joint.multiplier;
      }
      matter_.multiplyByM(state_, column_, M_column_);
      for (const Joint& joint : joints_) {
        if (joint.coordinate >= j) {
          M(joint.coordinate, j) += joint.multiplier * M_column_[joint.u];
        }
      }
    }
  }

  robot::Matrix M;  ///< its lower triangle
  robot::Vector bias;

 private:
  struct Joint {
    int q, u;  ///< Simbody's indices
    int coordinate;
    double multiplier, offset;
  };
  struct Mass {
    SimTK::MobilizedBodyIndex body;
    SimTK::Vec3 com, weight;
  };

  int num_joints_;
  SimTK::MultibodySystem system_;
  SimTK::SimbodyMatterSubsystem matter_;
  SimTK::State state_;
  SimTK::Vec3 gravity_;
  std::vector<Joint> joints_;
  std::vector<Mass> masses_;
  SimTK::Vector_<SimTK::SpatialVec> weights_;
  SimTK::Vector column_, M_column_, no_forces_, no_accelerations_, residual_;
};

/// The arm's equations as Simbody's integrators want it: an unconstrained system of q's and u's.
class ArmGuts : public SimTK::System::Guts {
 public:
  explicit ArmGuts(ArmMechanics& mechanics) : mechanics_(&mechanics) {}
  SimTK::SubsystemIndex subsystem;

 protected:
  ArmGuts* cloneImpl() const override { return new ArmGuts(*this); }

  int realizeTopologyImpl(SimTK::State& s) const override {
    const SimTK::Vector zero(static_cast<int>(mechanics_->x.size()), SimTK::Real(0));
    s.allocateQ(subsystem, zero);
    s.allocateU(subsystem, zero);
    return SimTK::System::Guts::realizeTopologyImpl(s);
  }
  int realizeVelocityImpl(const SimTK::State& s) const override {
    s.updQDot(subsystem) = s.getU(subsystem);
    return SimTK::System::Guts::realizeVelocityImpl(s);
  }
  int realizeAccelerationImpl(const SimTK::State& s) const override {
    SimTK::Vector& udot = s.updUDot(subsystem);
    mechanics_->accelerate(s.getTime(), &s.getQ(subsystem)[0], &s.getU(subsystem)[0], &udot[0]);
    s.updQDotDot(subsystem) = udot;
    return SimTK::System::Guts::realizeAccelerationImpl(s);
  }

  // qdot = u.
  using V = SimTK::Vector;
  void multiplyByNImpl(const SimTK::State&, const V& u, V& dq) const override { dq = u; }
  void multiplyByNTransposeImpl(const SimTK::State&, const V& fq, V& fu) const override { fu = fq; }
  void multiplyByNPInvImpl(const SimTK::State&, const V& dq, V& u) const override { u = dq; }
  void multiplyByNPInvTransposeImpl(const SimTK::State&, const V& fu, V& fq) const override {
    fq = fu;
  }

 private:
  ArmMechanics* mechanics_;
};

class ArmSystem : public SimTK::System {
 public:
  explicit ArmSystem(ArmMechanics& mechanics) {
    auto owned = std::make_unique<ArmGuts>(mechanics);
    ArmGuts& mine = *owned;
    adoptSystemGuts(owned.release());
    mine.subsystem = SimTK::DefaultSystemSubsystem(*this).getMySubsystemIndex();
    setHasTimeAdvancedEvents(false);
    realizeTopology();
  }
};

std::unique_ptr<SimTK::Integrator> make_integrator(Integrator method, const SimTK::System& system) {
  switch (method) {
    case Integrator::runge_kutta_merson:
      return std::make_unique<SimTK::RungeKuttaMersonIntegrator>(system);
    case Integrator::runge_kutta_3:
      return std::make_unique<SimTK::RungeKutta3Integrator>(system);
    case Integrator::runge_kutta_feldberg:
      return std::make_unique<SimTK::RungeKuttaFeldbergIntegrator>(system);
    case Integrator::semi_explicit_euler_2:
      return std::make_unique<SimTK::SemiExplicitEuler2Integrator>(system);
    case Integrator::verlet:
      return std::make_unique<SimTK::VerletIntegrator>(system);
    case Integrator::cpodes:
      return std::make_unique<SimTK::CPodesIntegrator>(system);
  }
  throw std::logic_error("plant::Arm: unknown integrator");
}

class SimbodyArm final : public ArmMechanics {
 public:
  SimbodyArm(const robot::Model& model, const ArmOptions& options, const ArmState& initial)
      : ArmMechanics(model, options, initial),
        tree_(model),
        system_(*this),
        integrator_(make_integrator(options.integrator.method, system_)) {
    if (options.drive.dry_friction()) {
      throw std::invalid_argument("Coulomb's friction needs the native mechanics");
    }
    integrator_->setAccuracy(options.integrator.accuracy);
    integrator_->setUseInfinityNorm(true);
    integrator_->setAllowInterpolation(false);
    integrator_->setInternalStepLimit(max_steps_per_advance);
  }

  [[nodiscard]] std::int64_t steps() const override { return integrator_->getNumStepsTaken(); }

  void advance(double time_s) override {
    const auto n = static_cast<int>(x.size());
    if (!initialized_) {
      SimTK::State start = system_.getDefaultState();
      for (int i = 0; i < n; ++i) {
        start.updQ()[i] = x[i];
        start.updU()[i] = xdot[i];
      }
      start.updTime() = now_s;
      integrator_->setInitialStepSize(time_s - now_s);
      integrator_->initialize(start);
      initialized_ = true;
    } else {
      // The torque jumps: derivatives of the old one must not enter the new tick. The step size
      // found so far stays.
      integrator_->updAdvancedState().invalidateAllCacheAtOrAbove(SimTK::Stage::Dynamics);
      integrator_->reinitialize(SimTK::Stage::Dynamics, false);
    }
    while (integrator_->getTime() < time_s) {
      if (integrator_->stepTo(time_s, time_s) == SimTK::Integrator::ReachedStepLimit) {
        throw too_many_steps();
      }
    }
    const SimTK::State& reached = integrator_->getState();
    for (int i = 0; i < n; ++i) {
      x[i] = reached.getQ()[i];
      xdot[i] = reached.getU()[i];
    }
    now_s = reached.getTime();
  }

 private:
  Links evaluate(const double* q, const double* v) override {
    tree_.evaluate(q, v);
    return {tree_.M, tree_.bias};
  }
  void solve(const double* /*v*/, robot::Vector& rhs) override {
    llt_.compute(tree_.M);
    if (llt_.info() != Eigen::Success) {
      throw std::runtime_error("the inertia matrix is not positive definite");
    }
    llt_.solveInPlace(rhs);
  }

  Tree tree_;
  Eigen::LLT<robot::Matrix> llt_;
  ArmSystem system_;
  std::unique_ptr<SimTK::Integrator> integrator_;
  bool initialized_ = false;
};

}  // namespace

std::unique_ptr<ArmMechanics> simbody_arm(const robot::Model& model, const ArmOptions& options,
                                          const ArmState& initial) {
  return std::make_unique<SimbodyArm>(model, options, initial);
}

}  // namespace tachless::plant
