// What a tick pays for mechanics: inverse dynamics over double and jets, the inertia matrix,
// forward dynamics, for the two-link arm (four bodies, two of them by mimic) and the seven-joint
// arm.
#include <benchmark/benchmark.h>

#include <fstream>
#include <iterator>
#include <string>

#include "robot/forward_dynamics.h"
#include "robot/inverse_dynamics.h"
#include "robot/jet.h"
#include "robot/mass_matrix.h"
#include "robot/model.h"

using namespace tachless;

namespace {

using robot::Jet2;
using robot::Model;
using robot::VectorOf;

Model load(int num_joints) {
  const std::string path = std::string(TACHLESS_SOURCE_DIR) + "/scenarios/robots/" +
                           (num_joints == 2 ? "two_link.urdf" : "iiwa7.urdf");
  std::ifstream in(path);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  return robot::model_from_urdf(text, path);
}

/// A state that changes a little with every iteration, so that nothing is computed beforehand.
template <class Scalar>
struct State {
  explicit State(int n) : q(n), v(n), a(n) {
    for (int i = 0; i < n; ++i) {
      q[i] = Scalar(0.3 * i - 0.4);
      v[i] = Scalar(0.5 - 0.1 * i);
      a[i] = Scalar(1.0 + i);
    }
  }
  void nudge() { q[0] += Scalar(1e-6); }
  VectorOf<Scalar> q, v, a;
};

template <class Scalar>
void inverse_dynamics(benchmark::State& bench) {
  const Model model = load(static_cast<int>(bench.range(0)));
  State<Scalar> s(model.num_joints);
  for (auto _ : bench) {
    s.nudge();
    benchmark::DoNotOptimize(robot::inverse_dynamics(model, s.q, s.v, s.a));
  }
}
BENCHMARK_TEMPLATE(inverse_dynamics, double)->Arg(2)->Arg(7);
BENCHMARK_TEMPLATE(inverse_dynamics, Jet2)->Arg(2)->Arg(7);

template <class Scalar>
void inverse_dynamics_bilinear(benchmark::State& bench) {
  const Model model = load(static_cast<int>(bench.range(0)));
  State<Scalar> s(model.num_joints);
  for (auto _ : bench) {
    s.nudge();
    benchmark::DoNotOptimize(robot::inverse_dynamics_bilinear(model, s.q, s.v, s.a, s.a));
  }
}
BENCHMARK_TEMPLATE(inverse_dynamics_bilinear, double)->Arg(2)->Arg(7);
BENCHMARK_TEMPLATE(inverse_dynamics_bilinear, Jet2)->Arg(2)->Arg(7);

void mass_matrix(benchmark::State& bench) {
  const Model model = load(static_cast<int>(bench.range(0)));
  State<double> s(model.num_joints);
  for (auto _ : bench) {
    s.nudge();
    benchmark::DoNotOptimize(robot::mass_matrix(model, s.q));
  }
}
BENCHMARK(mass_matrix)->Arg(2)->Arg(7);

void forward_dynamics(benchmark::State& bench) {
  const Model model = load(static_cast<int>(bench.range(0)));
  State<double> s(model.num_joints);
  for (auto _ : bench) {
    s.nudge();
    benchmark::DoNotOptimize(robot::forward_dynamics(model, s.q, s.v, s.a));
  }
}
BENCHMARK(forward_dynamics)->Arg(2)->Arg(7);

}  // namespace

BENCHMARK_MAIN();
