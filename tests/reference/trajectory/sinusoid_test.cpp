#include "reference/trajectory/sinusoid.h"

#include "tests/reference/trajectory/derivatives.h"

namespace tachless::reference::trajectory {
namespace {

robot::Vector pair(double x, double y) {
  robot::Vector v(2);
  v << x, y;
  return v;
}

TEST(Sinusoid, IsAMultiSineOfOneTermBitForBit) {
  const Sinusoid one{pair(0.1, 0.2), pair(5, 0.7), pair(0.3, -1), pair(0.5, -0.25)};
  const MultiSine same{one.offset_rad, {{one.amplitude_rad, one.frequency_hz, one.phase_rad}}};
  for (const double t : {0.0, 0.0317, 1.9}) {
    EXPECT_EQ(orders(one.at(t)), orders(same.at(t))) << t;
  }
  // sin(2 pi 5 0.05 + 0.3) = cos(0.3); two roundings.
  EXPECT_NEAR(one.at(0.05).q_ref[0], 0.5 + 0.1 * std::cos(0.3), 2e-16);
}

}  // namespace
}  // namespace tachless::reference::trajectory
