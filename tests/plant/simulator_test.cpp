// A simulator in the place of the emulator's mechanics, on the bus.

#include "plant/simulator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>
#include <string>
#include <vector>

#include "tests/plant/peers.h"

namespace tachless::plant {
namespace {

using base::ExitCode;
using testing::HasSubstr;

/// Two joints that stand where they are put and note each call.
class Recording final : public Simulator {
 public:
  void reset(const ArmState& initial) override {
    calls += 'r';
    now = initial;
  }
  ArmState state() override { return now; }
  void advance(const Vector& tau, double until_s) override {
    calls += 'a';
    torques.push_back(tau);
    ends.push_back(until_s);
    if (static_cast<int>(ends.size()) == fails_at) throw std::runtime_error("out of the world");
  }
  void brake(const Vector& /*damping*/) override { calls += 'b'; }

  ArmState now;
  std::string calls;
  std::vector<Vector> torques;
  std::vector<double> ends;
  int fails_at = 0;
};

TEST(SimulatorOnTheBus, AdvancesOnceATickAndIsBrakedAtTheEnd) {
  const scenario::Scenario s = scenario({"loop.max_missed=1000"});
  Peers peers(s);
  Recording simulator;
  const Outcome outcome = run(s, peers, nullptr, nullptr, &simulator);
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(simulator.calls, 'r' + std::string(30, 'a') + 'b');
  EXPECT_EQ(simulator.torques[5], torque_of(4));
  EXPECT_EQ(simulator.ends[29], 0.03);
  EXPECT_EQ(peers.truths.size(), 30U);
}

TEST(SimulatorOnTheBus, ThatThrowsInLockstepIsAProtectiveStop) {
  const scenario::Scenario s = scenario({"loop.mode=lockstep"});
  Peers peers(s);
  Recording simulator;
  simulator.fails_at = 5;
  const Outcome outcome = run(s, peers, nullptr, nullptr, &simulator);
  EXPECT_EQ(outcome.code, ExitCode::protective_stop);
  EXPECT_THAT(outcome.fault, HasSubstr("at tick 4: out of the world"));
}

}  // namespace
}  // namespace tachless::plant
