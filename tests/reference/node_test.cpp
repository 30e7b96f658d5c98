// The reference process against a plant that sends what a test wants.
#include "reference/node.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "reference/make_trajectory.h"
#include "tests/support/other_nodes.h"

namespace tachless::reference {
namespace {

using base::ExitCode;
using messages::Role;
using ::testing::HasSubstr;

constexpr std::int64_t run = support::OtherNodes::run;

/// The reference process of practical_rigid over 30 ticks, and its ports.
class AReference : public ::testing::Test {
 protected:
  explicit AReference(std::vector<std::string> overrides = {}) {
    scenario_ = support::thirty_ticks(std::move(overrides));
    others_.emplace(scenario_, Role::reference);
  }

  void tick(std::int64_t k, std::int64_t utime = 0, std::string from = "plant's address") {
    others_->then([this, k, utime, from] { others_->send(tick_, {utime, run, k}, {}, from); });
  }
  void change(const std::string& gains, std::int64_t k, std::int64_t number,
              const std::string& replaces = "", std::int64_t digest = 0) {
    others_->then([=, this] {
      const messages::GainChange wanted{gains, replaces, scenario_.digest + digest, number};
      others_->send(gains_, {0, run, k}, wanted, "somebody's address");
    });
  }
  support::NodeOutcome finish() {
    return support::run_among(*others_, scenario_, Role::reference,
                              [this](session::Session& session) { run_node(scenario_, session); });
  }
  std::vector<std::int64_t> published_ticks() {
    std::vector<std::int64_t> ticks;
    for (const auto& [stamp, value] : others_->values(reference_)) ticks.push_back(stamp.tick);
    return ticks;
  }
  static std::int64_t rejected(const support::NodeOutcome& outcome, std::string_view reason) {
    for (const auto& entry : outcome.statistics.rejected.entries()) {
      if (entry.reason == reason) return entry.count;
    }
    return -1;
  }

  scenario::Scenario scenario_;
  std::optional<support::OtherNodes> others_;
  messages::Layout layout_{.num_joints = 2, .num_motors = 0, .num_signals = 0};
  messages::Port<messages::Tick> tick_ = messages::port<messages::Tick>("ARM", layout_);
  messages::Port<messages::ReferencePoint> reference_ =
      messages::port<messages::ReferencePoint>("ARM", layout_);
  messages::Port<messages::GainChange> gains_ = messages::port<messages::GainChange>("ARM", {});
  messages::Port<messages::GainAck> acknowledgement_ = messages::port<messages::GainAck>("ARM", {});
};

class ARealtimeReference : public AReference {
 protected:
  ARealtimeReference() : AReference({"loop.mode=realtime"}) {}
};

class ALongRealtimeReference : public AReference {
 protected:
  ALongRealtimeReference() : AReference({"loop.mode=realtime", "loop.duration_s=3"}) {}
};

class AReferenceWhoseGainsMayChange : public AReference {
 protected:
  AReferenceWhoseGainsMayChange() : AReference({"controller.gains_may_change=true"}) {}
};

TEST_F(AReference, AnswersATickWithTheTrajectoryUpToTheNextTick) {
  for (std::int64_t k = 0; k < 30; ++k) tick(k);
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  const auto published = others_->values(reference_);
  ASSERT_EQ(published.size(), 30U);
  Trajectory trajectory = make_trajectory(scenario_);
  for (std::size_t k = 0; k < published.size(); ++k) {
    const auto& [stamp, point] = published[k];
    const messages::ReferencePoint expected = trajectory.at(static_cast<double>(k) * 1e-3);
    EXPECT_EQ(stamp.tick, static_cast<std::int64_t>(k));
    EXPECT_EQ(stamp.run, run);
    EXPECT_EQ(stamp.utime, static_cast<std::int64_t>(k) * 1000);
    EXPECT_EQ(point.q_ref, expected.q_ref);
    EXPECT_EQ(point.v_ref, expected.v_ref);
    EXPECT_EQ(point.a_ref, expected.a_ref);
  }
  EXPECT_EQ(outcome.statistics.ticks, 30);
  EXPECT_EQ(outcome.statistics.work_us.count(), 30);
  EXPECT_EQ(outcome.statistics.resends, 0);
}

TEST_F(AReference, PublishesNothingBeforeTheFirstTick) {
  others_->then([this] { EXPECT_TRUE(others_->published[reference_.channel].empty()); });
  tick(0);
  others_->then([this] { EXPECT_EQ(published_ticks(), (std::vector<std::int64_t>{0, 1})); });
  for (std::int64_t k = 1; k < 30; ++k) tick(k);
  EXPECT_EQ(finish().fault, "");
}

TEST_F(AReference, RepeatsTheSameBytesForARepeatedTick) {
  for (std::int64_t k = 0; k < 30; ++k) tick(k);
  tick(12);
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  const auto& published = others_->published[reference_.channel];
  ASSERT_EQ(published.size(), 32U);
  EXPECT_EQ(published[30], published[12]);
  EXPECT_EQ(published[31], published[13]);
  EXPECT_EQ(outcome.statistics.resends, 2);
  EXPECT_EQ(outcome.statistics.duplicates, 1);
}

TEST_F(AReference, AnswersNoTickThatThePlantCannotHaveBegun) {
  tick(2);
  for (std::int64_t k = 0; k < 30; ++k) tick(k);
  tick(30);
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(published_ticks().size(), 30U);
  EXPECT_EQ(rejected(outcome, "not_asked"), 2);
}

TEST_F(AReference, EndsWhenTwoPlantsSendTicks) {
  tick(0);
  tick(0, 1000, "another address");
  const auto outcome = finish();
  EXPECT_EQ(outcome.code, ExitCode::protocol_violated);
  EXPECT_THAT(outcome.fault, HasSubstr("another address"));
}

TEST_F(ARealtimeReference, SkipsLostTicksAndRepeatsNone) {
  tick(0);
  tick(0);
  tick(1);
  tick(4);
  tick(29);
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(published_ticks(), (std::vector<std::int64_t>{0, 1, 2, 4, 5, 29}));
  EXPECT_EQ(outcome.statistics.resends, 0);
}

TEST_F(ALongRealtimeReference, BelievesNoStrangersTickFarAhead) {
  tick(0);
  tick(2500, 0, "a stranger's address");  // of 2.5 s later
  tick(2999);
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(published_ticks(), (std::vector<std::int64_t>{0, 1, 2999}));
  EXPECT_EQ(rejected(outcome, "not_asked"), 1);
}

TEST_F(AReferenceWhoseGainsMayChange, SaysFromWhichTickOnAChangeHolds) {
  const std::string stiffer = "a=900;b=900;kd=900,50;kp=30000,2000";
  for (std::int64_t k = 0; k < 10; ++k) tick(k);
  change(stiffer, 9, 5);
  change(stiffer, 9, 5);  // its acknowledgement may be lost
  for (std::int64_t k = 10; k < 30; ++k) tick(k);
  ASSERT_EQ(finish().fault, "");
  const auto acknowledged = others_->values(acknowledgement_);
  ASSERT_EQ(acknowledged.size(), 2U);
  for (const auto& [stamp, value] : acknowledged) {
    EXPECT_EQ(stamp.tick, 11);  // reference 10 has been published
    EXPECT_EQ(value.number, 5);
  }
  for (const auto& [stamp, point] : others_->values(reference_)) {
    EXPECT_EQ(point.gains, stamp.tick < 11 ? "" : stiffer) << stamp.tick;
  }
}

TEST_F(AReferenceWhoseGainsMayChange, RefusesAChangeThatItsSenderHasNotAnalysedForThisRun) {
  const std::string first = "a=900;b=900;kd=900,50;kp=30000,2000";
  const std::string second = "a=800;b=800;kd=800,40;kp=20000,1000";
  change(first, 0, 1);  // before the first tick
  for (std::int64_t k = 0; k < 10; ++k) tick(k);
  change(first, 9, 2, "", 1);   // another scenario
  change(first, 9, 0);          // without a number
  change("a=900;b", 9, 3);      // no gains
  change(first, 11, 4);         // of a tick to come
  change(first, 9, 5, "a=1");   // has not seen the gains in force
  change(first, 9, 6);          // accepted
  change(second, 9, 7, first);  // has not seen tick 11, with which the last change begins
  for (std::int64_t k = 10; k < 20; ++k) tick(k);
  change(second, 11, 10, first);  // has not seen tick 12
  change(second, 12, 8);          // has not seen the gains in force
  change(second, 12, 9, first);   // accepted
  for (std::int64_t k = 20; k < 30; ++k) tick(k);
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  std::vector<std::int64_t> numbers, ticks;
  for (const auto& [stamp, value] : others_->values(acknowledgement_)) {
    numbers.push_back(value.number);
    ticks.push_back(stamp.tick);
  }
  EXPECT_EQ(numbers, (std::vector<std::int64_t>{6, 9}));
  EXPECT_EQ(ticks, (std::vector<std::int64_t>{11, 21}));
  EXPECT_EQ(rejected(outcome, "bad_value"), 3);
  EXPECT_EQ(rejected(outcome, "not_asked"), 2);
  EXPECT_EQ(rejected(outcome, "too_old"), 4);
}

TEST_F(AReference, TakesNoGainsWhereTheScenarioDoesNotSaySo) {
  for (std::int64_t k = 0; k < 10; ++k) tick(k);
  change("a=900;b=900;kd=900,50;kp=30000,2000", 9, 5);
  for (std::int64_t k = 10; k < 30; ++k) tick(k);
  ASSERT_EQ(finish().fault, "");
  EXPECT_TRUE(others_->published[acknowledgement_.channel].empty());
  for (const auto& [stamp, point] : others_->values(reference_)) EXPECT_EQ(point.gains, "");
}

}  // namespace
}  // namespace tachless::reference
