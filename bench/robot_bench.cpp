// What a tick pays for mechanics: inverse dynamics over double and jets, the inertia matrix,
// forward dynamics, for the two-link arm (2: four bodies, two of them by mimic), the seven-joint
// arm (7) and chains of 30 and 60 joints; and the same by Pinocchio and by DART, where CMake has
// found them, of the same tree.
#include <benchmark/benchmark.h>

#ifdef TACHLESS_HAS_DART
#include <dart/dynamics/BodyNode.hpp>
#include <dart/dynamics/PrismaticJoint.hpp>
#include <dart/dynamics/RevoluteJoint.hpp>
#include <dart/dynamics/Skeleton.hpp>
#endif
#ifdef TACHLESS_HAS_PINOCCHIO
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody/data.hpp>
#include <pinocchio/multibody/model.hpp>
#endif

#include <type_traits>

#include "robot/dynamics.h"
#include "robot/jet.h"
#include "robot/model.h"
#include "tests/robot/robots.h"

using namespace tachless;

namespace {

using robot::Jet2;
using robot::Model;
using robot::VectorOf;

Model load(int num_joints) {
  if (num_joints == 2) return robot::testing::two_link();
  if (num_joints == 7) return robot::testing::iiwa7();
  return robot::model_from_urdf(robot::testing::chain_urdf(num_joints), "chain");
}

/// A state that changes a little with every iteration, so that nothing is computed beforehand.
template <class Vector>
struct State {
  explicit State(int n) : q(n), v(n), a(n) {
    for (int i = 0; i < n; ++i) {
      q[i] = 0.3 * i - 0.4;
      v[i] = 0.5 - 0.1 * (i % 7);
      a[i] = 1.0 + i % 5;
    }
  }
  void nudge() { q[0] += 1e-6; }
  Vector q, v, a;
};

/// Times `compute(model, state)` at a state that moves.
template <class Scalar, class Compute>
void time(benchmark::State& bench, const Compute& compute) {
  const Model model = load(static_cast<int>(bench.range(0)));
  State<VectorOf<Scalar>> s(model.num_joints);
  for (auto _ : bench) {
    s.nudge();
    benchmark::DoNotOptimize(compute(model, s));
  }
}

template <class Scalar>
void inverse_dynamics(benchmark::State& bench) {
  time<Scalar>(bench, [](auto& m, auto& s) { return robot::inverse_dynamics(m, s.q, s.v, s.a); });
}
template <class Scalar>
void inverse_dynamics_bilinear(benchmark::State& bench) {
  time<Scalar>(bench, [](auto& m, auto& s) {
    return robot::inverse_dynamics_bilinear(m, s.q, s.v, s.a, s.a);
  });
}
template <class Scalar>
void mass_matrix(benchmark::State& bench) {
  time<Scalar>(bench, [](auto& m, auto& s) { return robot::mass_matrix(m, s.q); });
}
template <class Scalar>
void forward_dynamics(benchmark::State& bench) {
  time<Scalar>(bench, [](auto& m, auto& s) { return robot::forward_dynamics(m, s.q, s.v, s.a); });
}
#define TACHLESS_SIZES ->Arg(2)->Arg(7)->Arg(30)->Arg(60)
BENCHMARK_TEMPLATE(inverse_dynamics, double) TACHLESS_SIZES;
BENCHMARK_TEMPLATE(mass_matrix, double) TACHLESS_SIZES;
BENCHMARK_TEMPLATE(forward_dynamics, double) TACHLESS_SIZES;
BENCHMARK_TEMPLATE(inverse_dynamics_bilinear, double) TACHLESS_SIZES;
BENCHMARK_TEMPLATE(inverse_dynamics, Jet2) TACHLESS_SIZES;
BENCHMARK_TEMPLATE(inverse_dynamics_bilinear, Jet2) TACHLESS_SIZES;
BENCHMARK_TEMPLATE(mass_matrix, Jet2) TACHLESS_SIZES;
BENCHMARK_TEMPLATE(forward_dynamics, Jet2) TACHLESS_SIZES;

#ifdef TACHLESS_HAS_PINOCCHIO

/// The same tree; a mimic joint is one of its own there.
pinocchio::Model peer(const Model& model) {
  pinocchio::Model peer;
  peer.gravity.linear() = model.gravity;
  for (const robot::Body& b : model.bodies) {
    // The ground is joint 0, body i joint i + 1.
    const auto parent = static_cast<pinocchio::JointIndex>(b.parent + 1);
    const pinocchio::SE3 X(b.R_PB, b.p_PB);
    const bool revolute = b.type == robot::JointType::revolute;
    const auto joint =
        !revolute
            ? peer.addJoint(parent, pinocchio::JointModelPrismaticUnaligned(b.axis_B), X, b.joint)
        : b.axis_B == Eigen::Vector3d::UnitZ()
            ? peer.addJoint(parent, pinocchio::JointModelRZ(), X, b.joint)
            : peer.addJoint(parent, pinocchio::JointModelRevoluteUnaligned(b.axis_B), X, b.joint);
    peer.appendBodyToJoint(joint, pinocchio::Inertia(b.mass, b.p_Bcm, b.I_Bcm));
  }
  return peer;
}

template <class Compute>
void time_peer(benchmark::State& bench, const Compute& compute) {
  const pinocchio::Model model = peer(load(static_cast<int>(bench.range(0))));
  pinocchio::Data data(model);
  State<Eigen::VectorXd> s(model.nv);
  for (auto _ : bench) {
    s.nudge();
    compute(model, data, s);
    benchmark::ClobberMemory();
  }
}
constexpr auto world = pinocchio::Convention::WORLD;  // the faster of its two from 7 joints on
void pinocchio_rnea(benchmark::State& bench) {
  time_peer(bench, [](auto& m, auto& d, auto& s) { pinocchio::rnea(m, d, s.q, s.v, s.a); });
}
void pinocchio_crba(benchmark::State& bench) {
  time_peer(bench, [](auto& m, auto& d, auto& s) { pinocchio::crba(m, d, s.q, world); });
}
void pinocchio_aba(benchmark::State& bench) {
  time_peer(bench, [](auto& m, auto& d, auto& s) { pinocchio::aba(m, d, s.q, s.v, s.a, world); });
}
BENCHMARK(pinocchio_rnea) TACHLESS_SIZES;
BENCHMARK(pinocchio_crba) TACHLESS_SIZES;
BENCHMARK(pinocchio_aba) TACHLESS_SIZES;

#endif

#ifdef TACHLESS_HAS_DART

/// The same tree, as above.
dart::dynamics::SkeletonPtr dart_peer(const Model& model) {
  using namespace dart::dynamics;
  SkeletonPtr peer = Skeleton::create();
  peer->setGravity(model.gravity);
  for (const robot::Body& b : model.bodies) {
    BodyNode* const parent =
        b.parent < 0 ? nullptr : peer->getBodyNode(static_cast<std::size_t>(b.parent));
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    X.linear() = b.R_PB;
    X.translation() = b.p_PB;
    BodyNode::Properties body;
    body.mName = b.link;
    body.mInertia = Inertia(b.mass, b.p_Bcm, b.I_Bcm);
    const auto add = [&](auto joint) {
      using Joint = typename decltype(joint)::type;
      typename Joint::Properties properties;
      properties.mName = b.joint;
      properties.mT_ParentBodyToJoint = X;
      properties.mAxis = b.axis_B;
      peer->createJointAndBodyNodePair<Joint>(parent, properties, body);
    };
    if (b.type == robot::JointType::revolute) {
      add(std::type_identity<RevoluteJoint>());
    } else {
      add(std::type_identity<PrismaticJoint>());
    }
  }
  return peer;
}

/// DART computes nothing twice for the same state: positions and velocities are set each time.
template <class Compute>
void time_dart(benchmark::State& bench, const Compute& compute) {
  const dart::dynamics::SkeletonPtr peer = dart_peer(load(static_cast<int>(bench.range(0))));
  State<Eigen::VectorXd> s(static_cast<int>(peer->getNumDofs()));
  for (auto _ : bench) {
    s.nudge();
    peer->setPositions(s.q);
    peer->setVelocities(s.v);
    compute(*peer, s);
    benchmark::ClobberMemory();
  }
}
void dart_inverse_dynamics(benchmark::State& bench) {
  time_dart(bench, [](auto& peer, auto& s) {
    peer.setAccelerations(s.a);
    peer.computeInverseDynamics();
  });
}
void dart_mass_matrix(benchmark::State& bench) {
  time_dart(bench, [](auto& peer, auto&) { benchmark::DoNotOptimize(peer.getMassMatrix()); });
}
void dart_forward_dynamics(benchmark::State& bench) {
  time_dart(bench, [](auto& peer, auto& s) {
    peer.setForces(s.a);
    peer.computeForwardDynamics();
  });
}
BENCHMARK(dart_inverse_dynamics) TACHLESS_SIZES;
BENCHMARK(dart_mass_matrix) TACHLESS_SIZES;
BENCHMARK(dart_forward_dynamics) TACHLESS_SIZES;

#endif

}  // namespace

BENCHMARK_MAIN();
