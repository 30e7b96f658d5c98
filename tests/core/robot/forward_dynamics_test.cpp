#include "robot/dynamics.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cstdlib>
#include <stdexcept>

#include "tests/core/robot/robots.h"
#include "tests/support/rounding.h"
#include "tests/support/sanitizer.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define TACHLESS_COUNTS_ALLOCATIONS 0  // the sanitizers' own malloc is in place
#else
#define TACHLESS_COUNTS_ALLOCATIONS 1
namespace {
long allocations = 0;
}
extern "C" void* __libc_malloc(std::size_t);
extern "C" void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
#endif

namespace tachless::robot {
namespace {

using testing::Random;

class ForwardDynamics : public ::testing::TestWithParam<Model (*)()> {
 protected:
  const Model model = GetParam()();
  const Eigen::Index n = model.num_joints;
  Random random{5};
};
INSTANTIATE_TEST_SUITE_P(
    Robots, ForwardDynamics,
    ::testing::Values([] { return testing::two_link(); }, &testing::iiwa7, &testing::branching,
                      [] { return model_from_urdf(testing::chain_urdf(64, 64), "chain"); }));

TEST_P(ForwardDynamics, UndoesInverseDynamics) {
  for (int k = 0; k < 50; ++k) {
    const Vector q = random.vector(n, 2), v = random.vector(n, 2), a = random.vector(n, 5);
    const Vector tau = inverse_dynamics(model, q, v, a);
    const Vector bias = inverse_dynamics<double>(model, q, v, Vector::Zero(n));
    const auto lambda =
        Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(mass_matrix(model, q)).eigenvalues();
    // Backward stable solution: |error| <= c n eps cond(M) |a|, and what rounding in tau and in
    // the bias does through M^-1.
    const double allowed =
        8 * static_cast<double>(n) * eps *
        (lambda[n - 1] / lambda[0] * a.norm() + (tau.norm() + bias.norm()) / lambda[0]);
    EXPECT_LT((forward_dynamics(model, q, v, tau) - a).norm(), allowed);
  }
}

#if TACHLESS_COUNTS_ALLOCATIONS
TEST_P(ForwardDynamics, AllocatesNothingNorDoesWhatItCalls) {
  const Vector q = random.vector(n, 2), v = random.vector(n, 2), tau = random.vector(n, 2);
  const JetVector q_t = jet(q, v, tau);
  const long before = allocations;
  const Vector a = forward_dynamics(model, q, v, tau);
  const Vector back = inverse_dynamics(model, q, v, a);
  const Vector two = inverse_dynamics_bilinear(model, q, v, a, a);
  const JetVector jets = inverse_dynamics(model, q_t, q_t, q_t);
  EXPECT_EQ(allocations, before);
  EXPECT_TRUE(back.allFinite() && two.allFinite() && value(jets).allFinite() &&
              second_derivative(jets).allFinite());
}

TEST(AllocationCounter, Counts) {
  const long before = allocations;
  void* volatile block = std::malloc(8);
  std::free(block);
  EXPECT_EQ(allocations, before + 1);
}
#endif

TEST(ForwardDynamicsOfAMasslessRobot, IsABrokenPromise) {
  Model model = testing::two_link();
  for (Body& body : model.bodies) {
    body.mass = 0;
    body.I_Bcm.setZero();
  }
  const Vector zero = Vector::Zero(2);
  EXPECT_THROW(forward_dynamics(model, zero, zero, zero), std::logic_error);
}

}  // namespace
}  // namespace tachless::robot
