#include <SimTKsimbody.h>

#include <Eigen/Geometry>
#include <vector>

#include "base/elementary.h"
#include "plant/multibody.h"

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

/// A pin about the z axis of the mobilizer's frames. Simbody's own pin takes sine and cosine from
/// the C library, whose bits depend on the processor.
class Hinge final : public SimTK::MobilizedBody::Custom::Implementation {
 public:
  explicit Hinge(SimTK::SimbodyMatterSubsystem& matter) : Implementation(matter, 1, 1, 1) {}

  Implementation* clone() const override { return new Hinge(*this); }

  SimTK::Transform calcMobilizerTransformFromQ(const SimTK::State& /*state*/, int /*nq*/,
                                               const SimTK::Real* q) const override {
    double s = 0, c = 0;
    base::sin_cos(q[0], s, c);
    return SimTK::Transform(
        SimTK::Rotation(SimTK::Mat33(c, -s, 0, s, c, 0, 0, 0, 1), /*trustMe=*/true));
  }

  SimTK::SpatialVec multiplyByHMatrix(const SimTK::State& /*state*/, int /*nu*/,
                                      const SimTK::Real* u) const override {
    return {SimTK::Vec3(0, 0, u[0]), SimTK::Vec3(0)};
  }
  void multiplyByHTranspose(const SimTK::State& /*state*/, const SimTK::SpatialVec& force,
                            int /*nu*/, SimTK::Real* along) const override {
    along[0] = force[0][2];
  }
  /// The axis is constant in both frames.
  SimTK::SpatialVec multiplyByHDotMatrix(const SimTK::State& /*state*/, int /*nu*/,
                                         const SimTK::Real* /*u*/) const override {
    return {SimTK::Vec3(0), SimTK::Vec3(0)};
  }
  void multiplyByHDotTranspose(const SimTK::State& /*state*/, const SimTK::SpatialVec& /*force*/,
                               int /*nu*/, SimTK::Real* along) const override {
    along[0] = 0;
  }
};

/// The tree of bodies in Simbody, and its mechanics in independent coordinates: with
/// q_tree = G q + offset (G has one entry per row), M = G' M_tree G and bias = G' bias_tree.
/// Eliminating mimic joints by G instead of Simbody's coupler constraints leaves an ODE: no
/// constraint drift, no projection, and a sixth of the cost
/// (docs/decisions/0003-plant-integration).
///
/// M_tree and bias_tree are sums over Simbody's hinge columns, composite-body inertias and
/// centrifugal forces: its operators for them allocate at every call.
class SimbodyMultibody final : public Multibody {
 public:
  explicit SimbodyMultibody(const robot::Model& model)
      : num_joints_(model.num_joints), matter_(system_), gravity_(vec3(model.gravity)) {
    for (const robot::Body& body : model.bodies) {
      // Hinges turn about z and Simbody's sliders move along x of the mobilizer's frames F and M.
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
        SimTK::MobilizedBody::Custom(parent, new Hinge(matter_), X_PF, rigid, X_BM);
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
      links_.push_back({index, mobilized.getFirstQIndex(state_), mobilized.getFirstUIndex(state_),
                        body.parent, body.coordinate, body.multiplier, body.offset,
                        vec3(body.p_Bcm), body.mass * gravity_});
    }
    M_.resize(num_joints_, num_joints_);
    bias_.resize(num_joints_);
  }

  Terms evaluate(const Vector& q, const Vector& v) override {
    SimTK::Vector& q_tree = state_.updQ();
    SimTK::Vector& v_tree = state_.updU();
    for (const Link& link : links_) {
      q_tree[link.q] = link.multiplier * q[link.coordinate] + link.offset;
      v_tree[link.u] = link.multiplier * v[link.coordinate];
    }
    system_.realize(state_, SimTK::Stage::Velocity);
    matter_.realizeCompositeBodyInertias(state_);
    M_.setZero();
    bias_.setZero();
    for (Link& link : links_) {
      const SimTK::MobilizedBody& mobilized = matter_.getMobilizedBody(link.index);
      const SimTK::Transform& X_GB = mobilized.getBodyTransform(state_);
      link.origin = X_GB.p();
      link.hinge = mobilized.getHCol(state_, SimTK::MobilizerUIndex(0));
      link.force = matter_.getTotalCentrifugalForces(state_, link.index) -
                   SimTK::SpatialVec((X_GB.R() * link.com) % link.weight, link.weight);
    }
    for (std::size_t k = links_.size(); k-- > 0;) {
      const Link& link = links_[k];
      bias_[link.coordinate] += link.multiplier * (~link.hinge * link.force);
      if (link.parent >= 0) {
        Link& parent = links_[static_cast<std::size_t>(link.parent)];
        parent.force += at(parent, link, link.force);
      }
      add_inertia(link);
    }
    return {M_, bias_};
  }

 private:
  struct Link {
    SimTK::MobilizedBodyIndex index;
    int q, u;    ///< Simbody's indices
    int parent;  ///< -1: the ground
    int coordinate;
    double multiplier, offset;
    SimTK::Vec3 com, weight;  ///< in the body, in the ground
    // At the state, in the ground, about the body's origin:
    SimTK::Vec3 origin{};
    SimTK::SpatialVec hinge{};  ///< velocity in the parent at unit speed
    SimTK::SpatialVec force{};  ///< that the subtree needs at zero acceleration
  };

  /// A force about the child's origin, about the parent's.
  static SimTK::SpatialVec at(const Link& parent, const Link& child,
                              const SimTK::SpatialVec& force) {
    return {force[0] + (child.origin - parent.origin) % force[1], force[1]};
  }

  /// The row and column of `link` in M: what its unit acceleration asks of itself and of those
  /// that carry it.
  void add_inertia(const Link& link) {
    SimTK::SpatialVec force = matter_.getCompositeBodyInertia(state_, link.index) * link.hinge;
    M_(link.coordinate, link.coordinate) +=
        link.multiplier * link.multiplier * (~link.hinge * force);
    for (const Link* child = &link; child->parent >= 0;) {
      const Link& parent = links_[static_cast<std::size_t>(child->parent)];
      force = at(parent, *child, force);
      const double inertia = link.multiplier * parent.multiplier * (~parent.hinge * force);
      M_(link.coordinate, parent.coordinate) += inertia;
      M_(parent.coordinate, link.coordinate) += inertia;
      child = &parent;
    }
  }

  int num_joints_;
  Matrix M_;
  Vector bias_;
  SimTK::MultibodySystem system_;
  SimTK::SimbodyMatterSubsystem matter_;
  SimTK::State state_;
  SimTK::Vec3 gravity_;
  std::vector<Link> links_;
};

}  // namespace

std::unique_ptr<Multibody> simbody_multibody(const robot::Model& model) {
  return std::make_unique<SimbodyMultibody>(model);
}

}  // namespace tachless::plant
