// The controller process against a plant and a reference that send what a test wants.
#include "controller/node.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "controller/registry.h"
#include "session/message_ring.h"
#include "tests/support/other_nodes.h"

namespace tachless::controller {
namespace {

using base::ExitCode;
using messages::PositionMeasurement;
using messages::ReferencePoint;
using messages::Role;
using ::testing::AllOf;
using ::testing::HasSubstr;

using Ticks = std::vector<std::int64_t>;
constexpr std::int64_t run = support::OtherNodes::run;

/// The controller process of practical_rigid over 30 ticks, and its ports.
class AController : public ::testing::Test {
 protected:
  explicit AController(std::vector<std::string> overrides = {}) {
    scenario_ = support::thirty_ticks(std::move(overrides));
    others_.emplace(scenario_, Role::controller);
    const bool external = scenario_.controller.law == external_law_name;
    if (!external) law_ = scenario_law(scenario_);
    const messages::Layout layout =
        external ? messages::Layout{2, 0, 0} : law_layout(scenario_, *law_);
    position_.emplace(messages::port<PositionMeasurement>("ARM", layout));
    reference_.emplace(messages::port<ReferencePoint>("ARM", layout));
    command_.emplace(messages::port<messages::TorqueCommand>("ARM", layout));
    state_.emplace(messages::port<messages::LawSignals>("ARM", layout));
  }

  static PositionMeasurement position(std::int64_t k) {
    const double t = static_cast<double>(k) * 1e-3;
    Vector q(2);
    q << 0.1 + t, -0.2 - 2 * t * t;
    return {q};
  }
  static ReferencePoint point(std::int64_t k) {
    const double t = static_cast<double>(k) * 1e-3;
    Vector q(2), v(2);
    q << 0.1 + 1.1 * t, -0.2 - 0.1 * t;
    v << 1.1, -0.1;
    const Vector rest = Vector::Zero(2);
    return {q, v, rest, rest, rest};
  }
  void measure(std::int64_t k, const std::string& from = "plant's address", double offset = 0) {
    others_->then([=, this] {
      PositionMeasurement value = position(k);
      value.q[0] += offset;
      others_->send(*position_, {k * 1000 + 1, run, k}, value, from);
    });
  }
  void refer(std::int64_t k) {
    others_->then([=, this] {
      others_->send(*reference_, {k * 1000, run, k}, point(k), "reference's address");
    });
  }
  /// Sends the messages of all ticks from `first` on; a reference is a tick ahead.
  void go_on(std::int64_t first, std::int64_t end) {
    if (first == 0) refer(0);
    for (std::int64_t k = first; k < end; ++k) {
      if (k + 1 < 30) refer(k + 1);
      measure(k);
    }
  }
  support::NodeOutcome finish() { return finish_with(scenario_law(scenario_)); }
  support::NodeOutcome finish_with(ScenarioLaw law) {
    return support::run_among(
        *others_, scenario_, Role::controller,
        [&](session::Session& session) { run_node(scenario_, std::move(law), session); });
  }
  template <class Value>
  Ticks ticks_of(const messages::Port<Value>& port) {
    Ticks ticks;
    for (const auto& [stamp, value] : others_->values(port)) ticks.push_back(stamp.tick);
    return ticks;
  }
  /// Expects the torques and signals of the law itself over the ticks with a command.
  void expect_those_of_the_law() {
    const auto commands = others_->values(*command_);
    const auto states = others_->values(*state_);
    ASSERT_EQ(commands.size(), states.size());
    for (std::size_t i = 0; i < commands.size(); ++i) {
      const auto& [stamp, command] = commands[i];
      const Outcome expected = law_->step(stamp.tick, position(stamp.tick), point(stamp.tick));
      EXPECT_EQ(command.tau, expected.command.tau) << stamp.tick;
      EXPECT_EQ(stamp.run, run);
      EXPECT_EQ(stamp.utime, stamp.tick * 1000 + 1);  // the measurement's
      EXPECT_EQ(states[i].first.tick, stamp.tick);
      EXPECT_EQ(states[i].first.utime, stamp.utime);
      ASSERT_EQ(states[i].second.num, expected.signals.num);
      for (std::size_t j = 0; j < static_cast<std::size_t>(expected.signals.num); ++j) {
        EXPECT_EQ(states[i].second.value[j], expected.signals.value[j]) << stamp.tick;
      }
    }
  }

  scenario::Scenario scenario_;
  std::optional<support::OtherNodes> others_;
  ScenarioLaw law_;
  std::optional<messages::Port<PositionMeasurement>> position_;
  std::optional<messages::Port<ReferencePoint>> reference_;
  std::optional<messages::Port<messages::TorqueCommand>> command_;
  std::optional<messages::Port<messages::LawSignals>> state_;
};

class ARealtimeController : public AController {
 protected:
  ARealtimeController() : AController({"loop.mode=realtime", "loop.max_missed=5"}) {}
};

TEST_F(AController, CommandsWhatTheLawComputesAtEachTick) {
  go_on(0, 30);
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(ticks_of(*command_).size(), 30U);
  expect_those_of_the_law();
  EXPECT_EQ(outcome.statistics.ticks, 30);
  EXPECT_EQ(outcome.statistics.work_us.count(), 30);
  EXPECT_EQ(outcome.statistics.controller().gaps, 0);
}

TEST_F(AController, WaitsForTheLaterOfBothInputs) {
  measure(0);
  others_->then([this] { EXPECT_TRUE(others_->published[command_->channel].empty()); });
  refer(0);
  others_->then([this] { EXPECT_EQ(ticks_of(*command_), Ticks{0}); });
  refer(1);
  others_->then([this] { EXPECT_EQ(ticks_of(*command_), Ticks{0}); });
  measure(1);
  others_->then([this] { EXPECT_EQ(ticks_of(*command_), (Ticks{0, 1})); });
  refer(2);
  go_on(2, 30);
  EXPECT_EQ(finish().code, ExitCode::done);
  EXPECT_EQ(ticks_of(*command_).size(), 30U);
}

TEST_F(AController, RepeatsTheSameBytesForARepeatedMeasurement) {
  go_on(0, 20);
  measure(7);
  refer(7);  // a repeated reference asks for nothing
  go_on(20, 30);
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  for (const std::string& channel : {command_->channel, state_->channel}) {
    const auto& published = others_->published[channel];
    ASSERT_EQ(published.size(), 31U);
    EXPECT_EQ(published[20], published[7]);
  }
  EXPECT_EQ(outcome.statistics.resends, 2);
  EXPECT_EQ(outcome.statistics.duplicates, 2);
}

TEST_F(AController, KeepsNoMeasurementThatItHasNotAskedFor) {
  measure(0);
  measure(session::MessageRing::depth);  // it would have the place of tick 0
  refer(0);
  refer(1);
  go_on(1, 30);
  ASSERT_EQ(finish().fault, "");
  expect_those_of_the_law();
}

TEST_F(AController, EndsWhenTwoPlantsMeasure) {
  go_on(0, 3);
  measure(2, "another address", 1e-3);
  const auto outcome = finish();
  EXPECT_EQ(outcome.code, ExitCode::protocol_violated);
  EXPECT_THAT(outcome.fault, HasSubstr("another address"));
}

TEST_F(ARealtimeController, StepsOverTicksWhoseInputsAreLost) {
  go_on(0, 5);
  refer(6);
  refer(7);
  measure(7);  // 5 and 6 have no measurement
  refer(8);
  refer(9);
  measure(8);
  measure(10);  // without a reference
  refer(11);
  measure(11);
  refer(29);
  measure(29);  // after more ticks than the law steps over
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(ticks_of(*command_), (Ticks{0, 1, 2, 3, 4, 7, 8, 11, 29}));
  expect_those_of_the_law();
  const auto& counted = outcome.statistics.controller();
  EXPECT_EQ(counted.gaps, 3);
  EXPECT_EQ(counted.skipped_ticks, 2 + 2 + 17);
  EXPECT_EQ(counted.restarts, 1);
}

TEST_F(ARealtimeController, ActsOnTheNewestTickOnce) {
  go_on(0, 5);
  measure(4);  // again
  measure(3);  // overtaken
  refer(29);
  measure(29);
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(ticks_of(*command_), (Ticks{0, 1, 2, 3, 4, 29}));
  EXPECT_EQ(outcome.statistics.resends, 0);
}

TEST_F(ARealtimeController, CountsTheTicksAfterItsLastCommand) {
  go_on(0, 10);
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(outcome.statistics.controller().gaps, 1);
  EXPECT_EQ(outcome.statistics.controller().skipped_ticks, 20);
}

/// A law of a user that computes as a test wants.
class OwnLaw final : public AnyLaw {
 public:
  OwnLaw(const scenario::LoopSpec& loop, std::function<messages::TorqueCommand(std::int64_t)> law)
      : AnyLaw(loop), own_(std::move(law)) {}
  [[nodiscard]] std::string_view name() const override { return "own"; }
  [[nodiscard]] std::string_view measurement() const override { return "POSITION"; }
  [[nodiscard]] std::span<const messages::Signal> signals() const override { return {}; }

 private:
  void compute(std::int64_t tick, const messages::AnyMeasurement& /*measurement*/,
               const ReferencePoint& /*reference*/, int /*ticks*/) override {
    command_ = own_(tick);
  }
  std::function<messages::TorqueCommand(std::int64_t)> own_;
};

class AControllerWithOwnLaw : public AController {
 protected:
  AControllerWithOwnLaw()
      : AController({"controller.law=external", "controller.measurement=POSITION"}) {}
  /// Returns how a run ends whose law computes `faulty` at tick 7, and zero torques before.
  std::string end_of(const std::function<Vector()>& faulty) {
    others_.emplace(scenario_, Role::controller);
    go_on(0, 30);
    const auto law = [&](std::int64_t tick) -> messages::TorqueCommand {
      return {tick == 7 ? faulty() : Vector(Vector::Zero(2))};
    };
    const auto outcome = finish_with(std::make_unique<OwnLaw>(scenario_.loop, law));
    EXPECT_EQ(outcome.code, ExitCode::protective_stop);
    EXPECT_EQ(others_->published[command_->channel].size(), 7U);
    return outcome.fault;
  }
};

TEST_F(AControllerWithOwnLaw, StopsWhereTheLawIsWrong) {
  EXPECT_THAT(end_of([]() -> Vector { throw std::runtime_error("no idea"); }),
              HasSubstr("the law threw: no idea"));
  EXPECT_THAT(end_of([] { return Vector(Vector::Zero(3)); }),
              HasSubstr("returned 3 torques and 0 signals at tick 7; the robot has 2 joints"));
  EXPECT_THAT(end_of([] { return Vector(Vector::Constant(2, std::nan(""))); }),
              AllOf(HasSubstr("own"), HasSubstr("not finite")));
}

}  // namespace
}  // namespace tachless::controller
