#include "protocol/realtime/reference_responder.h"

#include <gtest/gtest.h>

#include "tests/protocol/lockstep/bytes_of.h"

namespace tachless::protocol::realtime {
namespace {

using lockstep::Verdict;

using Range = std::pair<std::int64_t, std::int64_t>;

Range ask(ReferenceResponder& responder, std::int64_t tick) {
  const auto answer = responder.on_tick(tick, BytesOf(1), "plant");
  EXPECT_EQ(answer.verdict, Verdict::fresh);
  return {answer.first, answer.last};
}

TEST(RealtimeReferenceResponder, IsOneTickAhead) {
  ReferenceResponder responder(100, 16);
  EXPECT_EQ(responder.newest(), -1);
  EXPECT_EQ(ask(responder, 0), Range(0, 1));
  EXPECT_EQ(ask(responder, 1), Range(2, 2));
  EXPECT_EQ(ask(responder, 2), Range(3, 3));
  EXPECT_EQ(responder.newest(), 3);
}

TEST(RealtimeReferenceResponder, HealsOneLostTickAndLeavesOutWhatWentBy) {
  ReferenceResponder responder(1000, 16);
  ask(responder, 0);
  EXPECT_EQ(ask(responder, 2), Range(2, 3));
  EXPECT_EQ(ask(responder, 500), Range(500, 501));
}

TEST(RealtimeReferenceResponder, HasNothingNewForATickThatWasOvertaken) {
  ReferenceResponder responder(100, 16);
  ask(responder, 5);
  const Range range = ask(responder, 4);
  EXPECT_LT(range.second, range.first);
  EXPECT_EQ(ask(responder, 6), Range(7, 7));
}

TEST(RealtimeReferenceResponder, AsksForNothingBeyondTheEnd) {
  ReferenceResponder responder(10, 16);
  EXPECT_EQ(ask(responder, 9), Range(9, 9));
  EXPECT_EQ(responder.on_tick(10, BytesOf(1), "plant").verdict, Verdict::not_asked);
  EXPECT_EQ(responder.on_tick(-1, BytesOf(1), "plant").verdict, Verdict::not_asked);
}

TEST(RealtimeReferenceResponder, NoticesASecondPlant) {
  ReferenceResponder responder(10, 16);
  ask(responder, 3);
  EXPECT_EQ(responder.on_tick(3, BytesOf(1), "plant").verdict, Verdict::repeated);
  EXPECT_EQ(responder.on_tick(3, BytesOf(9), "second").verdict, Verdict::conflicting);
  EXPECT_EQ(responder.sender_of(3), "plant");
}

}  // namespace
}  // namespace tachless::protocol::realtime
