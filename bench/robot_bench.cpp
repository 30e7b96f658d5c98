// Times inverse dynamics, inertia matrix and forward dynamics of the two-link arm (2: four bodies,
// two of them by mimic), the seven-joint arm (7) and a chain of 30 joints. If CMake has found
// Pinocchio, times its functions on the same trees too.
#include <benchmark/benchmark.h>

#ifdef TACHLESS_HAS_PINOCCHIO
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody/data.hpp>
#include <pinocchio/multibody/model.hpp>
#endif

#include "robot/dynamics.h"
#include "robot/model.h"
#include "tests/core/robot/robots.h"

using namespace tachless;

namespace {

using robot::Model;

Model load(int num_joints) {
  if (num_joints == 2) return robot::testing::two_link();
  if (num_joints == 7) return robot::testing::iiwa7();
  return robot::model_from_urdf(robot::testing::chain_urdf(num_joints), "chain");
}

/// A state that changes a little in every iteration, so nothing can be computed in advance.
struct State {
  explicit State(int n)
      : q(Vector::LinSpaced(n, -0.4, 0.3 * n - 0.7)),
        v(Vector::Constant(n, 0.5)),
        a(Vector::LinSpaced(n, 1, 5)) {}
  void nudge() { q[0] += 1e-6; }
  Vector q, v, a;
};

/// Times `compute(model, state)` with a changing state.
template <class Compute>
void time(benchmark::State& bench, const Compute& compute) {
  const Model model = load(static_cast<int>(bench.range(0)));
  State s(model.num_joints);
  for (auto _ : bench) {
    s.nudge();
    benchmark::DoNotOptimize(compute(model, s));
  }
}

void inverse_dynamics(benchmark::State& bench) {
  time(bench, [](auto& m, auto& s) { return robot::inverse_dynamics(m, s.q, s.v, s.a); });
}
void mass_matrix(benchmark::State& bench) {
  time(bench, [](auto& m, auto& s) { return robot::mass_matrix(m, s.q); });
}
void forward_dynamics(benchmark::State& bench) {
  time(bench, [](auto& m, auto& s) { return robot::forward_dynamics(m, s.q, s.v, s.a); });
}
#define TACHLESS_SIZES ->Arg(2)->Arg(7)->Arg(30)
BENCHMARK(inverse_dynamics) TACHLESS_SIZES;
BENCHMARK(mass_matrix) TACHLESS_SIZES;
BENCHMARK(forward_dynamics) TACHLESS_SIZES;

#ifdef TACHLESS_HAS_PINOCCHIO

/// Returns the same tree for Pinocchio, where a mimic joint is an independent joint.
pinocchio::Model peer(const Model& model) {
  pinocchio::Model peer;
  peer.gravity.linear() = model.gravity;
  for (const robot::Body& b : model.bodies) {
    // The ground is joint 0, and body i is joint i + 1.
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
  State s(model.nv);
  for (auto _ : bench) {
    s.nudge();
    compute(model, data, s);
    benchmark::ClobberMemory();
  }
}
// The faster of its two conventions from 7 joints on.
constexpr auto world = pinocchio::Convention::WORLD;
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

}  // namespace

BENCHMARK_MAIN();
