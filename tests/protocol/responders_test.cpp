#include "protocol/responders.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <utility>

#include "tests/protocol/bytes_of.h"

namespace tachless::protocol {
namespace {

class AReferenceResponder : public testing::Test {
 protected:
  ReferenceResponder::Answer ask(std::int64_t tick, std::uint64_t content = 0) {
    const auto answer = responder.on_tick(tick, BytesOf(content));
    for (std::int64_t k = answer.compute.first; k <= answer.compute.last; ++k) {
      responder.computed(k, BytesOf(100 + k));
    }
    return answer;
  }
  static std::vector<std::int64_t> ticks(ReferenceResponder::Range range) {
    std::vector<std::int64_t> result;
    for (std::int64_t k = range.first; k <= range.last; ++k) result.push_back(k);
    return result;
  }
  using Ticks = std::vector<std::int64_t>;

  static constexpr std::int64_t num_ticks = 200;
  ReferenceResponder responder{num_ticks, 8};
};

TEST_F(AReferenceResponder, StaysOneTickAhead) {
  EXPECT_EQ(ticks(ask(0).compute), (Ticks{0, 1}));
  EXPECT_EQ(ticks(ask(1).compute), (Ticks{2}));
  EXPECT_EQ(ticks(ask(2).compute), (Ticks{3}));
}

TEST_F(AReferenceResponder, HealsALostTickWithTheNext) {
  ask(0);
  const auto answer = ask(2);
  EXPECT_EQ(answer.verdict, Verdict::fresh);
  EXPECT_EQ(ticks(answer.compute), (Ticks{2, 3}));
}

TEST_F(AReferenceResponder, RepeatsWhatItKeepsForARepeatedTick) {
  ask(0);
  ask(1);
  const auto answer = ask(1);
  EXPECT_EQ(answer.verdict, Verdict::repeated);
  EXPECT_EQ(ticks(answer.compute), Ticks{});
  EXPECT_EQ(ticks(answer.repeat), (Ticks{1, 2}));
  EXPECT_EQ(number_in(responder.kept(2)), 102U);
}

TEST_F(AReferenceResponder, RepeatsForATickThatWasOvertaken) {
  ask(0);
  ask(2);
  ask(3);
  const auto answer = ask(1);
  EXPECT_EQ(answer.verdict, Verdict::fresh);
  EXPECT_EQ(ticks(answer.compute), Ticks{});
  EXPECT_EQ(ticks(answer.repeat), (Ticks{1, 2}));
}

TEST_F(AReferenceResponder, DoesNotRepeatInAnUndisturbedRun) {
  for (std::int64_t k = 0; k < num_ticks; ++k) EXPECT_EQ(ticks(ask(k).repeat), Ticks{}) << k;
  EXPECT_EQ(responder.newest(), num_ticks - 1);
}

TEST_F(AReferenceResponder, GoesNotBeyondTheLastTick) {
  for (std::int64_t k = 0; k < num_ticks; ++k) ask(k);
  EXPECT_EQ(ticks(ask(num_ticks - 1).repeat), (Ticks{num_ticks - 1}));
  EXPECT_EQ(ask(num_ticks).verdict, Verdict::not_asked);
}

TEST_F(AReferenceResponder, IgnoresTicksThatThePlantCannotHaveReached) {
  EXPECT_EQ(ask(1).verdict, Verdict::not_asked);
  ask(0);
  EXPECT_EQ(ask(3).verdict, Verdict::not_asked);
  EXPECT_EQ(ask(-1).verdict, Verdict::not_asked);
  EXPECT_EQ(responder.newest(), 1);
}

TEST_F(AReferenceResponder, ForgetsAfter64Ticks) {
  for (std::int64_t k = 0; k < 100; ++k) ask(k);
  EXPECT_EQ(responder.newest(), 100);
  EXPECT_EQ(ask(36).verdict, Verdict::too_old);
  EXPECT_EQ(ask(37).verdict, Verdict::repeated);
}

TEST_F(AReferenceResponder, SeesTwoPlants) {
  ask(0, 1);
  EXPECT_EQ(ask(0, 2).verdict, Verdict::conflicting);
}

TEST_F(AReferenceResponder, ComputesEachOnceInOrder) {
  ask(0);
  EXPECT_THROW(responder.computed(1, BytesOf(0)), std::logic_error);
  EXPECT_THROW(responder.computed(3, BytesOf(0)), std::logic_error);
}

using Range = std::pair<std::int64_t, std::int64_t>;

Range ask(ReferenceResponder& responder, std::int64_t tick) {
  const auto answer = responder.on_tick(tick, BytesOf(1));
  EXPECT_EQ(answer.verdict, Verdict::fresh);
  EXPECT_LT(answer.repeat.last, answer.repeat.first);
  for (std::int64_t k = answer.compute.first; k <= answer.compute.last; ++k) {
    responder.computed(k, BytesOf(k));
  }
  return {answer.compute.first, answer.compute.last};
}

TEST(ReferenceResponderInRealtime, IsOneTickAhead) {
  ReferenceResponder responder(100, 8, true);
  EXPECT_EQ(responder.newest(), -1);
  EXPECT_EQ(ask(responder, 0), Range(0, 1));
  EXPECT_EQ(ask(responder, 1), Range(2, 2));
  EXPECT_EQ(ask(responder, 2), Range(3, 3));
  EXPECT_EQ(responder.newest(), 3);
}

TEST(ReferenceResponderInRealtime, HealsOneLostTickAndLeavesOutWhatWentBy) {
  ReferenceResponder responder(1000, 8, true);
  ask(responder, 0);
  EXPECT_EQ(ask(responder, 2), Range(2, 3));
  EXPECT_EQ(ask(responder, 500), Range(500, 501));
}

TEST(ReferenceResponderInRealtime, HasNothingNewForATickThatWasOvertaken) {
  ReferenceResponder responder(100, 8, true);
  ask(responder, 5);
  const Range range = ask(responder, 4);
  EXPECT_LT(range.second, range.first);
  EXPECT_EQ(ask(responder, 6), Range(7, 7));
}

TEST(ReferenceResponderInRealtime, AsksForNothingBeyondTheEnd) {
  ReferenceResponder responder(10, 8, true);
  EXPECT_EQ(ask(responder, 9), Range(9, 9));
  EXPECT_EQ(responder.on_tick(10, BytesOf(1)).verdict, Verdict::not_asked);
  EXPECT_EQ(responder.on_tick(-1, BytesOf(1)).verdict, Verdict::not_asked);
}

TEST(ReferenceResponderInRealtime, NoticesASecondPlant) {
  ReferenceResponder responder(10, 8, true);
  ask(responder, 3);
  const auto again = responder.on_tick(3, BytesOf(1));
  EXPECT_EQ(again.verdict, Verdict::repeated);
  EXPECT_LT(again.repeat.last, again.repeat.first) << "nothing is published twice";
  EXPECT_EQ(responder.on_tick(3, BytesOf(9)).verdict, Verdict::conflicting);
}

using Action = CommandResponder::Action;

class ACommandResponder : public testing::Test {
 protected:
  CommandResponder::Answer measure(std::int64_t tick, std::uint64_t content = 0) {
    return responder.on_input(measurement_input, tick, BytesOf(content));
  }
  CommandResponder::Answer refer(std::int64_t tick, std::uint64_t content = 0) {
    return responder.on_input(reference_input, tick, BytesOf(content));
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

  CommandResponder responder{200, 8, 8};
};

TEST_F(ACommandResponder, ComputesWhenBothInputsAreThere) {
  EXPECT_EQ(refer(0).action, Action::nothing);
  EXPECT_EQ(measure(0).action, Action::compute);
  compute();
  EXPECT_EQ(responder.next(), 1);
  EXPECT_EQ(measure(1).action, Action::nothing);
  EXPECT_EQ(refer(1).action, Action::compute);
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
}  // namespace tachless::protocol
