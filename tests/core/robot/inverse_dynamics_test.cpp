#include "robot/dynamics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <string>

#include "tests/core/robot/energy.h"
#include "tests/core/robot/robots.h"
#include "tests/support/rounding.h"

namespace tachless::robot {
namespace {

using testing::Random;
using testing::TwoLinkClosedForm;

constexpr double pi = 3.14159265358979323846;
/// Rounding of some tens of operations on terms whose size the test states beside it.
constexpr double rounding = 64 * eps;

double largest(const Eigen::Ref<const Eigen::MatrixXd>& x) { return x.cwiseAbs().maxCoeff(); }

class TwoLink : public ::testing::TestWithParam<double> {
 protected:
  const Model model = testing::two_link(GetParam());
  const TwoLinkClosedForm closed{GetParam()};
  Random random{7};
};
INSTANTIATE_TEST_SUITE_P(Payload, TwoLink, ::testing::Values(0.0, 0.5));

TEST_P(TwoLink, HasTheInertiaCoriolisAndGravityOfTheClosedForm) {
  for (int k = 0; k < 1000; ++k) {
    const Vector q = random.vector(2, pi), v = random.vector(2, 5);
    // Sizes of the terms: M to 12, C to h |v| (times 2 in C12), g to g0 (g1 + g2).
    EXPECT_LT(largest(mass_matrix(model, q) - closed.M(q)), rounding * 12);
    EXPECT_LT(largest(coriolis_matrix(model, q, v) - closed.C(q, v)), rounding * 12 * v.norm());
    EXPECT_LT(largest(gravity_torque(model, q) - closed.g(q)), rounding * 100);
  }
}

TEST_P(TwoLink, AddsInertiaCoriolisAndGravityUp) {
  for (int k = 0; k < 1000; ++k) {
    const Vector q = random.vector(2, pi), v = random.vector(2, 5), a = random.vector(2, 20);
    const Vector expected = closed.M(q) * a + closed.C(q, v) * v + closed.g(q);
    // Terms to 12 * 20 + 2 * 50 + 100.
    EXPECT_LT(largest(inverse_dynamics(model, q, v, a) - expected), rounding * 440);
  }
}

TEST_P(TwoLink, CarriesJetsAsTheClosedFormDoes) {
  for (int k = 0; k < 1000; ++k) {
    const JetVector q = jet(random.vector(2, pi), random.vector(2, 3), random.vector(2, 9));
    const JetVector x = jet(random.vector(2, 3), random.vector(2, 9), random.vector(2, 30));
    const JetVector y = jet(random.vector(2, 3), random.vector(2, 9), random.vector(2, 30));
    const JetVector a = jet(random.vector(2, 9), random.vector(2, 30), random.vector(2, 90));
    const JetVector expected = closed.M(q) * a + closed.C(q, x) * y + closed.g(q);
    const JetVector tau = inverse_dynamics_bilinear(model, q, x, y, a);
    const JetVector square = inverse_dynamics(model, q, x, a);
    const JetVector expected_square = closed.M(q) * a + closed.C(q, x) * x + closed.g(q);
    // Second derivative: M a'' to 12 * 90, M' a' to 4 * 30, C to (1 + 3 + 9) 30 * 9 and so on.
    EXPECT_LT(largest(value(tau) - value(expected)), rounding * 500);
    EXPECT_LT(largest(first_derivative(tau) - first_derivative(expected)), rounding * 3000);
    EXPECT_LT(largest(second_derivative(tau) - second_derivative(expected)), rounding * 30000);
    EXPECT_LT(largest(second_derivative(square) - second_derivative(expected_square)),
              rounding * 30000);
  }
}

class AnyRobot : public ::testing::TestWithParam<Model (*)()> {
 protected:
  AnyRobot() {
    // Gravity of no special direction, and rotors, so that nothing is zero by luck.
    model.gravity = {1.5, -2.5, -9.0};
    model.rotor_inertia = Vector::LinSpaced(model.num_joints, 0.1, 0.7);
  }
  Model model = GetParam()();
  const Eigen::Index n = model.num_joints;
  Random random{11};
};
INSTANTIATE_TEST_SUITE_P(Robots, AnyRobot,
                         ::testing::Values([] { return testing::two_link(0.5); }, &testing::iiwa7,
                                           &testing::branching));

TEST_P(AnyRobot, SatisfiesLagrangesEquations) {
  // d/dt dT/dv - dT/dq + dU/dq from the energies alone: an independent formulation. dT/dv_j by
  // polarisation of the quadratic T, time and joint derivatives by jets.
  for (int k = 0; k < 100; ++k) {
    const Vector q = random.vector(n, 1), v = random.vector(n, 2), a = random.vector(n, 5);
    const Vector tau = inverse_dynamics(model, q, v, a), zero = Vector::Zero(n);
    const JetVector q_t = jet(q, v, a), v_t = jet(v, a, zero);
    for (Eigen::Index j = 0; j < n; ++j) {
      const Vector e = Vector::Unit(n, j);
      const JetVector e_j = jet(e, zero, zero), q_j = jet(q, e, zero), v_j = jet(v, zero, zero);
      const JetVector plus = v_t + e_j, minus = v_t - e_j;
      const Jet2 momentum = 0.5 * (testing::kinetic_energy(model, q_t, plus) -
                                   testing::kinetic_energy(model, q_t, minus));
      const double expected = momentum.first - testing::kinetic_energy(model, q_j, v_j).first +
                              potential_energy(model, q_j).first;
      // Polarisation cancels energies of up to 300 J and their rates of up to 3000 W.
      EXPECT_NEAR(tau[j], expected, rounding * 3000) << "joint " << j;
    }
  }
}

TEST_P(AnyRobot, HasMdotMinusTwiceCSkew) {
  for (int k = 0; k < 100; ++k) {
    const Vector q = random.vector(n, pi), v = random.vector(n, 3), zero = Vector::Zero(n);
    const MatrixOf<Jet2> M = mass_matrix(model, jet(q, v, zero));
    Matrix S = -2 * coriolis_matrix(model, q, v);
    for (Eigen::Index i = 0; i < n; ++i) {
      for (Eigen::Index j = 0; j < n; ++j) S(i, j) += M(i, j).first;
    }
    // M to 20 kg m2, its rate to a few times |v| of that.
    EXPECT_LT(largest(S + S.transpose()), rounding * 20 * (1 + 4 * v.norm()));
  }
}

TEST_P(AnyRobot, HasACoriolisProductSymmetricToTheLastBit) {
  for (int k = 0; k < 100; ++k) {
    const Vector q = random.vector(n, pi), x = random.vector(n, 3), y = random.vector(n, 3);
    EXPECT_EQ(coriolis_product(model, q, x, y), coriolis_product(model, q, y, x));
  }
}

TEST_P(AnyRobot, HasCoriolisMatricesWithTheBitsOfTheProduct) {
  const Vector q = random.vector(n, pi), v = random.vector(n, 3);
  const std::vector<Eigen::MatrixXd> C = coriolis_matrices(model, q);
  ASSERT_EQ(C.size(), static_cast<std::size_t>(n));
  for (Eigen::Index j = 0; j < n; ++j) {
    const Vector along = Vector::Unit(n, j);
    EXPECT_EQ(coriolis_matrix(model, q, v).col(j), coriolis_product(model, q, v, along));
    for (Eigen::Index k = 0; k < n; ++k) {
      EXPECT_EQ(C[static_cast<std::size_t>(j)].col(k),
                coriolis_product(model, q, along, Vector::Unit(n, k)));
    }
  }
}

TEST_P(AnyRobot, HasACoriolisProductThatIsBilinearAndGivesTheQuadraticTerm) {
  for (int k = 0; k < 100; ++k) {
    const Vector q = random.vector(n, pi), x = random.vector(n, 3), y = random.vector(n, 3);
    const Vector z = random.vector(n, 3), zero = Vector::Zero(n), sum = x + 2 * z;
    const double size = 100 * (1 + x.squaredNorm() + y.squaredNorm() + z.squaredNorm());
    EXPECT_LT(largest(coriolis_product(model, q, sum, y) -
                      (coriolis_product(model, q, x, y) + 2 * coriolis_product(model, q, z, y))),
              rounding * size);
    EXPECT_LT(largest(coriolis_matrix(model, q, x) * y - coriolis_product(model, q, x, y)),
              rounding * size);
    EXPECT_LT(largest(inverse_dynamics(model, q, x, zero) -
                      (coriolis_product(model, q, x, x) + gravity_torque(model, q))),
              rounding * size);
    const Vector a = random.vector(n, 5);
    EXPECT_LT(largest(inverse_dynamics_bilinear(model, q, x, y, a) -
                      (mass_matrix(model, q) * a + coriolis_product(model, q, x, y) +
                       gravity_torque(model, q))),
              rounding * size);
  }
}

TEST(MimicJoints, GiveTheTorqueOfTheFreeTreeProjectedOnTheCoordinates) {
  // q_tree = G q + offset, tau = G' tau_tree: the same file without its mimic elements.
  for (const char* file : {"scenarios/robots/two_link.urdf", "tests/core/robot/branching.urdf"}) {
    const Model model = testing::load(file);
    std::string text = testing::read_text(std::string(TACHLESS_SOURCE_DIR) + "/" + file);
    for (std::size_t at = text.find("<mimic "); at != std::string::npos;
         at = text.find("<mimic ", at)) {
      text.erase(at, text.find('>', at) + 1 - at);
    }
    const Model tree = model_from_urdf(text, file);
    const Eigen::Index n = model.num_joints, n_tree = tree.num_joints;
    ASSERT_EQ(n_tree, static_cast<Eigen::Index>(model.bodies.size()));
    Matrix G = Matrix::Zero(n_tree, n);
    Vector offset(n_tree);
    for (Eigen::Index i = 0; i < n_tree; ++i) {
      const Body& body = model.bodies[static_cast<std::size_t>(i)];
      ASSERT_EQ(body.joint, tree.joint_names[static_cast<std::size_t>(i)]);
      G(i, body.coordinate) = body.multiplier;
      offset[i] = body.offset;
    }
    Random random(13);
    for (int k = 0; k < 100; ++k) {
      const Vector q = random.vector(n, 2), v = random.vector(n, 2), a = random.vector(n, 5);
      const Vector q_tree = G * q + offset, v_tree = G * v, a_tree = G * a;
      const Vector tau_tree = inverse_dynamics(tree, q_tree, v_tree, a_tree);
      // Torques to 300 N m.
      EXPECT_LT(largest(inverse_dynamics(model, q, v, a) - G.transpose() * tau_tree),
                rounding * 300);
      EXPECT_LT(largest(mass_matrix(model, q) - G.transpose() * mass_matrix(tree, q_tree) * G),
                rounding * 20);
    }
  }
}

/// Torque along q_i(t) = sin(w_i t + i), and the trajectory's derivatives in closed form.
struct Motion {
  explicit Motion(Eigen::Index size) : n(size) {}
  [[nodiscard]] Vector derivative(int order, double t) const {
    Vector x(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double w = 0.7 + 0.1 * static_cast<double>(i);
      x[i] = std::pow(w, order) * std::sin(w * t + static_cast<double>(i) + order * pi / 2);
    }
    return x;
  }
  [[nodiscard]] Vector torque(const Model& model, double t) const {
    return inverse_dynamics(model, derivative(0, t), derivative(1, t), derivative(2, t));
  }
  Eigen::Index n;
};

TEST_P(AnyRobot, CarriesJetsAsEighthOrderDifferencesDo) {
  const Motion motion(n);
  const double h = 0.04;
  for (const double t : {0.0, 0.8, 2.3, 5.1}) {
    const JetVector tau = inverse_dynamics(
        model, jet(motion.derivative(0, t), motion.derivative(1, t), motion.derivative(2, t)),
        jet(motion.derivative(1, t), motion.derivative(2, t), motion.derivative(3, t)),
        jet(motion.derivative(2, t), motion.derivative(3, t), motion.derivative(4, t)));
    constexpr double d1[] = {4.0 / 5, -1.0 / 5, 4.0 / 105, -1.0 / 280};
    constexpr double d2[] = {8.0 / 5, -1.0 / 5, 8.0 / 315, -1.0 / 560};
    Vector first = Vector::Zero(n), second = -205.0 / 72 * motion.torque(model, t);
    for (int k = 1; k <= 4; ++k) {
      const Vector ahead = motion.torque(model, t + k * h), back = motion.torque(model, t - k * h);
      first += d1[k - 1] * (ahead - back);
      second += d2[k - 1] * (ahead + back);
    }
    first /= h;
    second /= h * h;
    // Truncation h^8 f^(9)/630 and h^8 f^(10)/3150, frequencies to 4 rad/s in products of the
    // trajectory: about 5e-9 of the torque's size (100 N m); rounding is far below.
    EXPECT_LT(largest(value(tau) - motion.torque(model, t)), rounding * 1000);
    EXPECT_LT(largest(first_derivative(tau) - first), 1e-6);
    EXPECT_LT(largest(second_derivative(tau) - second), 1e-6);
  }
}

TEST_P(AnyRobot, AddsRotorInertiaToTheDiagonalAlone) {
  const Vector q = random.vector(n, 1), v = random.vector(n, 1), a = random.vector(n, 5);
  Model bare = model;
  bare.rotor_inertia.setZero();
  const Vector added = inverse_dynamics(model, q, v, a) - inverse_dynamics(bare, q, v, a);
  EXPECT_LT(largest(added - model.rotor_inertia.cwiseProduct(a)), rounding * 200);
  bare.rotor_inertia.resize(0);
  EXPECT_EQ(inverse_dynamics(bare, q, v, a).size(), n);
}

TEST_P(AnyRobot, RefusesAVectorOfWrongSize) {
  const Vector good = Vector::Zero(n), bad = Vector::Zero(n + 1);
  EXPECT_THROW(inverse_dynamics(model, bad, good, good), std::logic_error);
  EXPECT_THROW(inverse_dynamics(model, good, bad, good), std::logic_error);
  EXPECT_THROW(inverse_dynamics(model, good, good, bad), std::logic_error);
}

}  // namespace
}  // namespace tachless::robot
