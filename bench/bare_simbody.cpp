#include "bench/bare_simbody.h"

#include <Simbody.h>

#include <Eigen/Geometry>

using tachless::robot::Body;
using tachless::robot::Model;

namespace {

SimTK::Vec3 vec3(const Eigen::Vector3d& x) { return {x.x(), x.y(), x.z()}; }

SimTK::Rotation rotation(const Eigen::Matrix3d& R) {
  return SimTK::Rotation(
      SimTK::Mat33(R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)),
      true);
}

SimTK::Inertia inertia(const Eigen::Matrix3d& I) {
  return SimTK::Inertia(SimTK::Vec3(I(0, 0), I(1, 1), I(2, 2)),
                        SimTK::Vec3(I(1, 0), I(2, 0), I(2, 1)));
}

}  // namespace

struct BareSimbody::Impl {
  SimTK::MultibodySystem system;
  SimTK::SimbodyMatterSubsystem matter{system};
  SimTK::GeneralForceSubsystem forces{system};
  SimTK::Force::DiscreteForces drives{forces, matter};
  std::unique_ptr<SimTK::RungeKuttaMersonIntegrator> integrator;
};

BareSimbody::BareSimbody(const Model& model, double q, double v, double accuracy)
    : impl_(std::make_unique<Impl>()) {
  SimTK::Force::Gravity(impl_->forces, impl_->matter, vec3(model.gravity));
  for (const Body& body : model.bodies) {
    const SimTK::Rotation R_BM =
        rotation(Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), body.axis_B)
                     .toRotationMatrix());
    SimTK::MobilizedBody& parent =
        impl_->matter.updMobilizedBody(SimTK::MobilizedBodyIndex(body.parent + 1));
    const SimTK::Body::Rigid rigid(SimTK::MassProperties(
        body.mass, vec3(body.p_Bcm),
        inertia(body.I_Bcm).shiftFromMassCenter(-vec3(body.p_Bcm), body.mass)));
    SimTK::MobilizedBody::Pin(parent, {rotation(body.R_PB) * R_BM, vec3(body.p_PB)}, rigid,
                              {R_BM, SimTK::Vec3(0)});
  }
  SimTK::State state = impl_->system.realizeTopology();
  impl_->system.realizeModel(state);
  state.updQ() = q;
  state.updU() = v;
  impl_->integrator = std::make_unique<SimTK::RungeKuttaMersonIntegrator>(impl_->system);
  impl_->integrator->setAccuracy(accuracy);
  impl_->integrator->setUseInfinityNorm(true);
  impl_->integrator->setAllowInterpolation(false);
  impl_->integrator->initialize(state);
}
BareSimbody::~BareSimbody() = default;

double BareSimbody::q(int joint) const { return impl_->integrator->getState().getQ()[joint]; }

void BareSimbody::advance(const tachless::robot::Vector& tau, double time_s) {
  SimTK::State& state = impl_->integrator->updAdvancedState();
  for (int i = 0; i < tau.size(); ++i) {
    impl_->drives.setOneMobilityForce(
        state, impl_->matter.getMobilizedBody(SimTK::MobilizedBodyIndex(i + 1)),
        SimTK::MobilizerUIndex(0), tau[i]);
  }
  impl_->integrator->reinitialize(SimTK::Stage::Dynamics, false);
  while (impl_->integrator->getTime() < time_s) impl_->integrator->stepTo(time_s, time_s);
}
