#include "reference/trajectory/sinusoids.h"

#include <numbers>

#include "tests/reference/trajectory/derivatives.h"

namespace tachless::reference::trajectory {
namespace {

Vector pair(double x, double y) {
  Vector v(2);
  v << x, y;
  return v;
}

MultiSine papers_reference() {
  const double amplitude = 1 / (10 * std::numbers::pi);
  return {pair(0, 0), {{pair(amplitude, amplitude), pair(5, 5), pair(0, 0)}}};
}

TEST(MultiSine, IsThePapersReferenceWithOneTerm) {
  const MultiSine reference = papers_reference();
  const messages::ReferencePoint start = reference.at(0);
  EXPECT_EQ(start.q_ref, pair(0, 0));
  // sin(10 pi t) / (10 pi) has unit speed at t = 0; one rounding of the product.
  EXPECT_NEAR(start.v_ref[0], 1, 1e-15);
  EXPECT_EQ(start.a_ref, pair(0, 0));
  const double t = 0.037;
  EXPECT_NEAR(reference.at(t).q_ref[1],
              std::sin(10 * std::numbers::pi * t) / (10 * std::numbers::pi), 1e-16);
}

TEST(MultiSine, SumsItsTermsAndItsOffset) {
  const MultiSine two{
      pair(0.5, -1),
      {{pair(0.1, 0.2), pair(1, 2), pair(0, 0.3)}, {pair(-0.3, 0.05), pair(3, 0.5), pair(1, -2)}}};
  const auto expected = [](double t, int i) {
    const double f[2][2] = {{1, 2}, {3, 0.5}};
    const double A[2][2] = {{0.1, 0.2}, {-0.3, 0.05}};
    const double p[2][2] = {{0, 0.3}, {1, -2}};
    return (i == 0 ? 0.5 : -1.0) +
           A[0][i] * std::sin(2 * std::numbers::pi * f[0][i] * t + p[0][i]) +
           A[1][i] * std::sin(2 * std::numbers::pi * f[1][i] * t + p[1][i]);
  };
  for (const double t : {0.0, 0.2, 1.7}) {
    for (int i = 0; i < 2; ++i) {
      EXPECT_NEAR(two.at(t).q_ref[i], expected(t, i), 1e-15);  // same terms, another order
    }
  }
}

TEST(MultiSine, EachDerivativeIsThatOfTheOneBefore) {
  MultiSine reference = papers_reference();
  reference.terms.push_back({pair(0.2, -0.1), pair(0.7, 3), pair(0.4, 2)});
  const double step = 1e-3;
  // step^8 / 630 (10 pi)^9 amplitudes (0.13 together), and 10 pi more for each order.
  const double first = std::pow(step, 8) / 630 * std::pow(10 * std::numbers::pi, 9) * 0.14;
  const double w = 10 * std::numbers::pi;
  for (int i = 1; i < 100; ++i) {
    expect_derivatives_of_each_other(reference, 0.0137 * i, step,
                                     {first, w * first, w * w * first, w * w * w * first});
  }
}

TEST(Sinusoid, IsAMultiSineOfOneTermBitForBit) {
  const Sinusoid one{{pair(0.1, 0.2), pair(5, 0.7), pair(0.3, -1)}, pair(0.5, -0.25)};
  const MultiSine same{one.offset_rad, {{one.amplitude_rad, one.frequency_hz, one.phase_rad}}};
  for (const double t : {0.0, 0.0317, 1.9}) {
    EXPECT_EQ(orders(one.at(t)), orders(same.at(t))) << t;
  }
  // sin(2 pi 5 0.05 + 0.3) = cos(0.3); two roundings.
  EXPECT_NEAR(one.at(0.05).q_ref[0], 0.5 + 0.1 * std::cos(0.3), 2e-16);
}

}  // namespace
}  // namespace tachless::reference::trajectory
