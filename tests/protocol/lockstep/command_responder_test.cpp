#include "protocol/lockstep/command_responder.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "tests/protocol/lockstep/bytes_of.h"

namespace tachless::protocol::lockstep {
namespace {

using Action = CommandResponder::Action;

class ACommandResponder : public testing::Test {
 protected:
  CommandResponder::Answer measure(std::int64_t tick, std::uint64_t content = 0) {
    return responder.on_measurement(tick, BytesOf(content), "plant");
  }
  CommandResponder::Answer refer(std::int64_t tick, std::uint64_t content = 0) {
    return responder.on_reference(tick, BytesOf(content), "reference");
  }
  void compute() { responder.computed(BytesOf(100 + responder.next()), BytesOf(responder.next())); }
  void run_through(std::int64_t ticks) {
    refer(0);
    while (responder.next() < ticks) {
      refer(responder.next() + 1);
      ASSERT_EQ(measure(responder.next()).action, Action::compute);
      compute();
    }
  }

  CommandResponder responder{200, {8, 8, 8, 8}};
};

TEST_F(ACommandResponder, ComputesWhenBothInputsAreThere) {
  EXPECT_EQ(refer(0).action, Action::nothing);
  EXPECT_EQ(measure(0).action, Action::compute);
  compute();
  EXPECT_EQ(responder.next(), 1);
  EXPECT_EQ(measure(1).action, Action::nothing);
  EXPECT_EQ(refer(1).action, Action::compute);
}

TEST_F(ACommandResponder, ThatResumesKeepsWhatItsPredecessorWasAskedUntilItsTurnComes) {
  responder.resume(70);
  EXPECT_EQ(measure(72).verdict, Verdict::fresh);
  EXPECT_EQ(measure(71).verdict, Verdict::fresh);
  for (const std::int64_t k : {73, 72, 71}) {
    EXPECT_EQ(refer(k).action, Action::nothing) << "70 comes first";
  }
  EXPECT_EQ(refer(70).action, Action::nothing);
  EXPECT_EQ(measure(70).action, Action::compute);
  compute();
  EXPECT_TRUE(responder.ready());
  compute();
  EXPECT_TRUE(responder.ready());
  compute();
  EXPECT_FALSE(responder.ready()) << "73 is referred to, but not measured";
  EXPECT_EQ(measure(73).action, Action::compute);
}

TEST_F(ACommandResponder, ThatResumesReachesNoFurtherThanMessagesAreKept) {
  responder.resume(70);
  EXPECT_EQ(measure(70 + CommandResponder::reach).verdict, Verdict::not_asked);
  EXPECT_EQ(refer(70 + CommandResponder::reach).verdict, Verdict::not_asked);
  EXPECT_EQ(measure(70 + CommandResponder::reach - 1).verdict, Verdict::fresh);
  EXPECT_EQ(refer(70 + CommandResponder::reach - 1).verdict, Verdict::fresh);
}

TEST_F(ACommandResponder, ThatResumesRepeatsNoAnswerOfItsPredecessor) {
  responder.resume(70);
  EXPECT_EQ(measure(69).action, Action::nothing);
  EXPECT_EQ(measure(69).action, Action::nothing);
}

TEST_F(ACommandResponder, RepeatsTheKeptAnswerToARepeatedMeasurement) {
  run_through(2);
  const auto answer = measure(0);
  EXPECT_EQ(answer.verdict, Verdict::repeated);
  EXPECT_EQ(answer.action, Action::repeat);
  EXPECT_EQ(number_in(responder.command(0)), 100U);
  EXPECT_EQ(number_in(responder.state(1)), 1U);
}

TEST_F(ACommandResponder, HasNothingToRepeatBeforeTheReferenceIsThere) {
  measure(0);
  EXPECT_EQ(measure(0).action, Action::nothing);
}

TEST_F(ACommandResponder, DoesNotComputeAgainForARepeatedReference) {
  run_through(2);
  EXPECT_EQ(refer(1).action, Action::nothing);
  EXPECT_EQ(refer(1).verdict, Verdict::repeated);
}

TEST_F(ACommandResponder, IgnoresTicksOutOfTurn) {
  EXPECT_EQ(measure(1).verdict, Verdict::not_asked);
  EXPECT_EQ(refer(2).verdict, Verdict::not_asked);
  EXPECT_EQ(refer(1).verdict, Verdict::fresh);
  EXPECT_EQ(measure(-1).verdict, Verdict::not_asked);
  run_through(199);
  EXPECT_EQ(refer(200).verdict, Verdict::not_asked);
  refer(199);
  measure(199);
  compute();
  EXPECT_EQ(measure(200).verdict, Verdict::not_asked);
}

TEST_F(ACommandResponder, SeesTwoPlantsAndTwoReferences) {
  run_through(1);
  EXPECT_EQ(measure(0, 9).verdict, Verdict::conflicting);
  EXPECT_EQ(measure(0, 9).action, Action::nothing);
  EXPECT_EQ(refer(1, 9).verdict, Verdict::conflicting);
  EXPECT_EQ(responder.sender_of(CommandResponder::Input::measurement, 0), "plant");
  EXPECT_EQ(responder.sender_of(CommandResponder::Input::reference, 1), "reference");
}

TEST_F(ACommandResponder, ForgetsAfter64Ticks) {
  run_through(100);
  EXPECT_EQ(measure(36).verdict, Verdict::too_old);
  EXPECT_EQ(measure(37).action, Action::repeat);
}

TEST_F(ACommandResponder, ComputesNothingTwiceOrWithoutInputs) {
  EXPECT_THROW(compute(), std::logic_error);
  run_through(1);
  EXPECT_THROW(compute(), std::logic_error);
}

}  // namespace
}  // namespace tachless::protocol::lockstep
