#include "protocol/lockstep/reference_responder.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "tests/protocol/lockstep/bytes_of.h"

namespace tachless::protocol::lockstep {
namespace {

class AReferenceResponder : public testing::Test {
 protected:
  ReferenceResponder::Answer ask(std::int64_t tick, std::uint64_t content = 0) {
    const auto answer = responder.on_tick(tick, BytesOf(content), "plant");
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
  ReferenceResponder responder{num_ticks, 8, 8};
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
  EXPECT_EQ(responder.sender_of(0), "plant");
}

TEST_F(AReferenceResponder, ComputesEachOnceInOrder) {
  ask(0);
  EXPECT_THROW(responder.computed(1, BytesOf(0)), std::logic_error);
  EXPECT_THROW(responder.computed(3, BytesOf(0)), std::logic_error);
}

}  // namespace
}  // namespace tachless::protocol::lockstep
