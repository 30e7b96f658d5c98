#include "session/message_ring.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "tests/core/session/bytes_of.h"

namespace tachless::session {
namespace {

MessageRing ring() { return MessageRing(std::array<std::size_t, 2>{8, 8}); }

TEST(MessageRing, KeepsEachKindOfATick) {
  MessageRing messages = ring();
  EXPECT_EQ(messages.put(3, 0, BytesOf(7)), Receipt::fresh);
  EXPECT_TRUE(messages.has(3, 0));
  EXPECT_FALSE(messages.has(3, 1));
  EXPECT_EQ(messages.put(3, 1, BytesOf(8)), Receipt::fresh);
  EXPECT_EQ(number_in(messages.bytes(3, 0)), 7U);
  EXPECT_EQ(number_in(messages.bytes(3, 1)), 8U);
}

TEST(MessageRing, TellsARepetitionFromAContradictionAndKeepsTheFirst) {
  MessageRing messages = ring();
  messages.put(3, 0, BytesOf(7));
  EXPECT_EQ(messages.put(3, 0, BytesOf(7)), Receipt::repeated);
  EXPECT_EQ(messages.put(3, 0, BytesOf(9)), Receipt::conflicting);
  EXPECT_EQ(messages.put(3, 0, BytesOf(7).operator std::span<const std::byte>().first(4)),
            Receipt::conflicting);
  EXPECT_EQ(number_in(messages.bytes(3, 0)), 7U);
}

TEST(MessageRing, KeepsADigestWhereACopyHasOnlyToBeRecognised) {
  MessageRing messages(std::array<std::size_t, 1>{MessageRing::digest_only});
  EXPECT_EQ(messages.put(3, 0, BytesOf(7)), Receipt::fresh);
  EXPECT_TRUE(messages.has(3, 0));
  EXPECT_EQ(messages.put(3, 0, BytesOf(7)), Receipt::repeated);
  EXPECT_EQ(messages.put(3, 0, BytesOf(9)), Receipt::conflicting);
  EXPECT_EQ(messages.put(4, 0, BytesOf(9)), Receipt::fresh);
  EXPECT_TRUE(messages.bytes(3, 0).empty());
}

TEST(MessageRing, KeepsExactlyTheLast64Ticks) {
  MessageRing messages = ring();
  for (std::int64_t tick = 0; tick < 65; ++tick) messages.put(tick, 0, BytesOf(tick));
  EXPECT_FALSE(messages.has(0, 0));
  EXPECT_TRUE(messages.has(1, 0));
  EXPECT_EQ(messages.put(0, 0, BytesOf(0)), Receipt::too_old);
  EXPECT_EQ(messages.put(0, 1, BytesOf(0)), Receipt::too_old);
  EXPECT_TRUE(messages.has(64, 0));
  EXPECT_FALSE(messages.has(64, 1));
}

TEST(MessageRing, RefusesWhatBreaksItsPromises) {
  MessageRing messages = ring();
  const std::array<std::byte, 9> nine{};
  EXPECT_THROW(messages.put(0, 0, nine), std::logic_error);
  EXPECT_THROW(messages.put(-1, 0, BytesOf(1)), std::logic_error);
  EXPECT_THROW((void)messages.bytes(0, 0), std::logic_error);
}

}  // namespace
}  // namespace tachless::session
