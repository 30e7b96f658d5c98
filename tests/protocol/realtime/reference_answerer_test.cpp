#include "protocol/realtime/reference_answerer.h"

#include <gtest/gtest.h>

#include "tests/protocol/lockstep/bytes_of.h"

namespace tachless::protocol::realtime {
namespace {

using lockstep::Verdict;

using Range = std::pair<std::int64_t, std::int64_t>;

Range ask(ReferenceAnswerer& answerer, std::int64_t tick) {
  const auto answer = answerer.on_tick(tick, BytesOf(1), "plant");
  EXPECT_EQ(answer.verdict, Verdict::fresh);
  return {answer.first, answer.last};
}

TEST(RealtimeReferenceAnswerer, IsOneTickAhead) {
  ReferenceAnswerer answerer(100, 16);
  EXPECT_EQ(ask(answerer, 0), Range(0, 1));
  EXPECT_EQ(ask(answerer, 1), Range(2, 2));
  EXPECT_EQ(ask(answerer, 2), Range(3, 3));
  EXPECT_EQ(answerer.newest(), 3);
}

TEST(RealtimeReferenceAnswerer, HealsOneLostTickAndLeavesOutWhatWentBy) {
  ReferenceAnswerer answerer(1000, 16);
  ask(answerer, 0);
  EXPECT_EQ(ask(answerer, 2), Range(2, 3));
  EXPECT_EQ(ask(answerer, 500), Range(500, 501));
}

TEST(RealtimeReferenceAnswerer, HasNothingNewForATickThatWasOvertaken) {
  ReferenceAnswerer answerer(100, 16);
  ask(answerer, 5);
  const Range range = ask(answerer, 4);
  EXPECT_LT(range.second, range.first);
  EXPECT_EQ(ask(answerer, 6), Range(7, 7));
}

TEST(RealtimeReferenceAnswerer, AsksForNothingBeyondTheEnd) {
  ReferenceAnswerer answerer(10, 16);
  EXPECT_EQ(ask(answerer, 9), Range(9, 9));
  EXPECT_EQ(answerer.on_tick(10, BytesOf(1), "plant").verdict, Verdict::not_asked);
  EXPECT_EQ(answerer.on_tick(-1, BytesOf(1), "plant").verdict, Verdict::not_asked);
}

TEST(RealtimeReferenceAnswerer, NoticesASecondPlant) {
  ReferenceAnswerer answerer(10, 16);
  ask(answerer, 3);
  EXPECT_EQ(answerer.on_tick(3, BytesOf(1), "plant").verdict, Verdict::repeated);
  EXPECT_EQ(answerer.on_tick(3, BytesOf(9), "second").verdict, Verdict::conflicting);
  EXPECT_EQ(answerer.asker(3), "plant");
}

}  // namespace
}  // namespace tachless::protocol::realtime
