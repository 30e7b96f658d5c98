#include <gtest/gtest.h>

#include <cstddef>
#include <cstdlib>
#include <tuple>

#include "controller/any_law.h"
#include "controller/laws.h"
#include "tests/controller/law/two_link.h"
#include "tests/support/counting_new.h"

namespace tachless::controller::law {
namespace {

template <class L>
typename L::Robot arm() {
  if constexpr (std::is_same_v<typename L::Robot, FlexibleRobot>) {
    return {two_link_model(), vector(1e4, 1e4), vector(0.1, 0.1)};
  } else {
    return two_link_model();
  }
}

template <class L>
L example() {
  typename L::Gains gains;
  base::for_each_key<typename L::Gains>(
      [&]<class Member>(const base::Key<typename L::Gains, Member>& key) {
        if constexpr (std::is_same_v<Member, Vector>) {
          gains.*key.member = vector(10, 10);
        } else if constexpr (std::is_same_v<Member, Matrix>) {
          gains.*key.member = vector(10, 10).asDiagonal();
        } else {
          gains.*key.member = 2;
        }
      });
  Settings settings;
  settings.torque_limit = vector(100, 100);
  return L(arm<L>(), gains, settings);
}

void measure(messages::PositionMeasurement& m) { m.q = vector(0.1, 0.2); }
void measure(messages::MotorPositionMeasurement& m) { m.theta = vector(0.1, 0.2); }
void measure(messages::BothPositionsMeasurement& m) { m.q = m.theta = vector(0.1, 0.2); }
void measure(messages::LinkStateMeasurement& m) {
  m.q = m.theta = vector(0.1, 0.2);
  m.v = vector(1, 2);
}
void measure(messages::StateMeasurement& m) {
  m.q = m.theta = vector(0.1, 0.2);
  m.v = m.thetadot = vector(1, 2);
}

template <class L>
class Allocation : public testing::Test {};

template <class List>
struct TypesOf;
template <class... L>
struct TypesOf<LawList<L...>> {
  using type = testing::Types<L...>;
};
TYPED_TEST_SUITE(Allocation, TypesOf<Laws>::type);

TYPED_TEST(Allocation, NoneInStartAndSteps) {
  scenario::LoopSpec loop;
  loop.mode = scenario::Mode::realtime;
  LawWithMemory<TypeParam> law(example<TypeParam>(), loop);
  const Vector r = vector(0.3, 0.4);
  const messages::ReferencePoint ref{r, r, r, r, r};
  typename TypeParam::Measurement measured;
  measure(measured);

  const std::size_t before = allocations;
  double sum = 0;
  std::int64_t tick = 0;
  for (int k = 0; k < 101; ++k) {
    sum += law.step(tick, measured, ref).command.tau[0];
    tick += k % 3 + 1;
  }
  const std::size_t after = allocations;
  EXPECT_EQ(after - before, 0U);
  EXPECT_TRUE(std::isfinite(sum));
}

TEST(AllocationCount, SeesWhatIsAllocated) {
  const std::size_t before = allocations;
  const Eigen::VectorXd in_eigen = Eigen::VectorXd::Ones(1000);
  const auto by_new = std::make_unique<double[]>(1000);
  EXPECT_GE(allocations - before, 2U);
  EXPECT_GT(in_eigen.sum() + by_new[0], 0);
}

}  // namespace
}  // namespace tachless::controller::law
