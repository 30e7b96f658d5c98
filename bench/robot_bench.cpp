// What a tick pays for mechanics: inverse dynamics over double and jets, the inertia matrix,
// forward dynamics, for the two-link arm (2: four bodies, two of them by mimic), the seven-joint
// arm (7) and chains of 30 and 60 joints; and the same by Pinocchio, where CMake has found it, of
// the same tree.
#include <benchmark/benchmark.h>

#ifdef TACHLESS_HAS_PINOCCHIO
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody/data.hpp>
#include <pinocchio/multibody/model.hpp>
#endif

#include "robot/forward_dynamics.h"
#include "robot/inverse_dynamics.h"
#include "robot/jet.h"
#include "robot/mass_matrix.h"
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
void pinocchio_rnea(benchmark::State& bench) {
  time_peer(bench, [](auto& m, auto& d, auto& s) { pinocchio::rnea(m, d, s.q, s.v, s.a); });
}
void pinocchio_crba(benchmark::State& bench) {
  time_peer(bench, [](auto& m, auto& d, auto& s) { pinocchio::crba(m, d, s.q); });
}
void pinocchio_aba(benchmark::State& bench) {
  time_peer(bench, [](auto& m, auto& d, auto& s) { pinocchio::aba(m, d, s.q, s.v, s.a); });
}
BENCHMARK(pinocchio_rnea) TACHLESS_SIZES;
BENCHMARK(pinocchio_crba) TACHLESS_SIZES;
BENCHMARK(pinocchio_aba) TACHLESS_SIZES;

#endif

}  // namespace

BENCHMARK_MAIN();
