#include "session/responders.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "tests/core/session/bytes_of.h"

namespace tachless::session {
namespace {

using Ticks = std::vector<std::int64_t>;

Ticks ticks(ReferenceResponder::Range range) {
  Ticks result;
  for (std::int64_t k = range.first; k <= range.last; ++k) result.push_back(k);
  return result;
}

constexpr std::int64_t num_ticks = 1000;

ReferenceResponder::Answer ask(ReferenceResponder& responder, std::int64_t tick,
                               std::uint64_t content = 0) {
  const auto answer = responder.on_tick(tick, BytesOf(content));
  for (const std::int64_t k : ticks(answer.compute)) responder.on_computed(k, BytesOf(100 + k));
  return answer;
}

struct Asked {
  std::int64_t tick;
  Receipt receipt;
  Ticks compute = {}, repeat = {};
};

TEST(ReferenceResponder, ComputesEachReferenceOnceAndOneTickAhead) {
  constexpr auto fresh = Receipt::fresh, again = Receipt::repeated, no = Receipt::not_asked;
  const std::vector<std::pair<bool, std::vector<Asked>>> runs = {
      // Lockstep: ticks that the plant cannot have reached are ignored; a repeated tick is
      // answered.
      {false,
       {{1, no},
        {0, fresh, {0, 1}},
        {3, no},
        {-1, no},
        {1, fresh, {2}},
        {2, fresh, {3}},
        {1, again, {}, {1, 2}}}},
      // The next tick makes up for a lost one; an overtaken tick is repeated.
      {false, {{0, fresh, {0, 1}}, {2, fresh, {2, 3}}, {3, fresh, {4}}, {1, fresh, {}, {1, 2}}}},
      // Realtime: past ticks are left out, and no reference is published twice.
      {true,
       {{0, fresh, {0, 1}},
        {1, fresh, {2}},
        {3, fresh, {3, 4}},
        {500, fresh, {500, 501}},
        {499, fresh},
        {501, fresh, {502}},
        {501, again},
        {num_ticks - 1, fresh, {num_ticks - 1}},
        {num_ticks, no},
        {-1, no}}}};
  for (const auto& [realtime, run] : runs) {
    ReferenceResponder responder(num_ticks, 8, realtime);
    EXPECT_EQ(responder.newest(), -1);
    for (const Asked& each : run) {
      SCOPED_TRACE((realtime ? "realtime " : "lockstep ") + std::to_string(each.tick));
      const auto answer = ask(responder, each.tick);
      EXPECT_EQ(answer.receipt, each.receipt);
      EXPECT_EQ(ticks(answer.compute), each.compute);
      EXPECT_EQ(ticks(answer.repeat), each.repeat);
      for (const std::int64_t k : each.repeat) EXPECT_EQ(number_in(responder.kept(k)), 100U + k);
    }
  }
}

TEST(ReferenceResponder, RepeatsNothingInAnUndisturbedRunAndKeeps64Ticks) {
  ReferenceResponder responder(num_ticks, 8);
  for (std::int64_t k = 0; k < num_ticks; ++k) {
    EXPECT_EQ(ticks(ask(responder, k).repeat), Ticks{}) << k;
  }
  EXPECT_EQ(responder.newest(), num_ticks - 1);
  EXPECT_EQ(ticks(ask(responder, num_ticks - 1).repeat), Ticks{num_ticks - 1});
  EXPECT_EQ(ask(responder, num_ticks).receipt, Receipt::not_asked);
  EXPECT_EQ(ask(responder, num_ticks - 65).receipt, Receipt::too_old);
  EXPECT_EQ(ask(responder, num_ticks - 64).receipt, Receipt::repeated);
}

TEST(ReferenceResponder, NoticesASecondPlant) {
  for (const bool realtime : {false, true}) {
    ReferenceResponder responder(num_ticks, 8, realtime);
    ask(responder, 0, 1);
    EXPECT_EQ(ask(responder, 0, 2).receipt, Receipt::conflicting);
    EXPECT_THROW(responder.on_computed(1, BytesOf(0)), std::logic_error);
    EXPECT_THROW(responder.on_computed(realtime ? 0 : 3, BytesOf(0)), std::logic_error);
  }
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
  void compute() {
    responder.on_computed(BytesOf(100 + responder.next()), BytesOf(responder.next()));
  }
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
  EXPECT_EQ(answer.receipt, Receipt::repeated);
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
  EXPECT_EQ(refer(1).receipt, Receipt::repeated);
}

TEST_F(ACommandResponder, IgnoresTicksOutOfTurn) {
  EXPECT_EQ(measure(1).receipt, Receipt::not_asked);
  EXPECT_EQ(refer(2).receipt, Receipt::not_asked);
  EXPECT_EQ(refer(1).receipt, Receipt::fresh);
  EXPECT_EQ(measure(-1).receipt, Receipt::not_asked);
  run_through(199);
  EXPECT_EQ(refer(200).receipt, Receipt::not_asked);
  refer(199);
  measure(199);
  compute();
  EXPECT_EQ(measure(200).receipt, Receipt::not_asked);
}

TEST_F(ACommandResponder, SeesTwoPlantsAndTwoReferences) {
  run_through(1);
  EXPECT_EQ(measure(0, 9).receipt, Receipt::conflicting);
  EXPECT_EQ(measure(0, 9).action, Action::nothing);
  EXPECT_EQ(refer(1, 9).receipt, Receipt::conflicting);
}

TEST_F(ACommandResponder, ForgetsAfter64Ticks) {
  run_through(100);
  EXPECT_EQ(measure(36).receipt, Receipt::too_old);
  EXPECT_EQ(measure(37).action, Action::repeat);
}

TEST_F(ACommandResponder, ComputesNothingTwiceOrWithoutInputs) {
  EXPECT_THROW(compute(), std::logic_error);
  run_through(1);
  EXPECT_THROW(compute(), std::logic_error);
}

}  // namespace
}  // namespace tachless::session
