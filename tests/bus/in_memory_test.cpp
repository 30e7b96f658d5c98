#include "tests/support/in_memory.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <thread>

namespace tachless::bus {
namespace {

using namespace std::chrono_literals;

std::vector<std::byte> bytes(int number) {
  std::vector<std::byte> result(sizeof number);
  std::memcpy(result.data(), &number, sizeof number);
  return result;
}

int number(const Datagram& datagram) {
  int result = -1;
  std::memcpy(&result, datagram.payload.data(), sizeof result);
  return result;
}

std::vector<int> everything(Transport& transport) {
  std::vector<int> result;
  while (const auto datagram = transport.receive({})) result.push_back(number(*datagram));
  return result;
}

TEST(AnInMemoryNetwork, DeliversToSubscribersOfExactlyTheChannelButNotToTheSender) {
  InMemoryNetwork network;
  const auto a = network.connect("a");
  const auto b = network.connect("b");
  const auto c = network.connect("c");
  a->subscribe("ARM_TICK");
  b->subscribe("ARM_TICK");
  c->subscribe("ARM_TICK_2");
  a->publish("ARM_TICK", bytes(5));
  const auto datagram = b->receive({});
  ASSERT_TRUE(datagram);
  EXPECT_EQ(datagram->channel, "ARM_TICK");
  EXPECT_EQ(datagram->sender, "a");
  EXPECT_EQ(number(*datagram), 5);
  EXPECT_FALSE(a->receive({}));
  EXPECT_FALSE(c->receive({}));
}

TEST(AnInMemoryNetwork, LosesWhatComesWhileTheReceiveBufferIsFull) {
  InMemoryNetwork network;
  const auto a = network.connect("a");
  const auto b = network.connect("b");
  b->subscribe("X");
  constexpr int holds = InMemoryNetwork::receive_buffer;
  for (int i = 0; i < holds + 5; ++i) a->publish("X", bytes(i));
  const auto received = everything(*b);
  ASSERT_EQ(received.size(), static_cast<std::size_t>(holds));
  EXPECT_EQ(received.back(), holds - 1);
  EXPECT_EQ(network.num_overflowed("b"), 5);
  EXPECT_EQ(network.num_overflowed("a"), 0);
  a->publish("X", bytes(-3));
  EXPECT_EQ(everything(*b), std::vector<int>{-3});
}

TEST(AnInMemoryNetwork, WithoutFaultsKeepsOrderAndLosesNothing) {
  InMemoryNetwork network;
  const auto a = network.connect("a");
  const auto b = network.connect("b");
  b->subscribe("X");
  for (int i = 0; i < 1000; ++i) a->publish("X", bytes(i));
  const auto received = everything(*b);
  ASSERT_EQ(received.size(), 1000U);
  EXPECT_TRUE(std::ranges::is_sorted(received));
}

TEST(AnInMemoryNetwork, LosesDuplicatesAndReordersAsOftenAsAsked) {
  constexpr int count = 20'000;
  InMemoryNetwork network({.loss = 0.3, .duplication = 0.1, .reordering = 0.2, .seed = 3});
  const auto a = network.connect("a");
  const auto b = network.connect("b");
  b->subscribe("X");
  std::map<int, int> copies;
  int descents = 0;
  int last = -1;
  for (int i = 0; i < count; ++i) {
    a->publish("X", bytes(i));
    if ((i + 1) % 1000 != 0) continue;  // read before the receive buffer is full
    for (const int each : everything(*b)) {
      ++copies[each];
      descents += each < last ? 1 : 0;
      last = each;
    }
  }
  int twice = 0;
  for (const auto& [message, n] : copies) twice += n == 2 ? 1 : 0;
  // Five standard deviations of a binomial of 20,000 are at most 350.
  EXPECT_NEAR(copies.size(), 0.7 * count, 350);
  EXPECT_NEAR(twice, 0.07 * count, 350);
  EXPECT_GT(descents, 0.05 * count);
}

TEST(AnInMemoryNetwork, DoesTheSameAgainWithTheSameSeed) {
  const auto received = [](std::uint64_t seed) {
    InMemoryNetwork network({.loss = 0.3, .duplication = 0.1, .reordering = 0.2, .seed = seed});
    const auto a = network.connect("a");
    const auto b = network.connect("b");
    b->subscribe("X");
    for (int i = 0; i < 200; ++i) a->publish("X", bytes(i));
    return everything(*b);
  };
  EXPECT_EQ(received(1), received(1));
  EXPECT_NE(received(1), received(2));
}

TEST(AnInMemoryNetwork, YieldsNothingAfterTheDeadlineAndWakesOnArrival) {
  InMemoryNetwork network;
  const auto a = network.connect("a");
  const auto b = network.connect("b");
  b->subscribe("X");
  EXPECT_FALSE(b->receive(loop::Clock::now() + 1ms));
  std::thread sender([&] { a->publish("X", bytes(1)); });
  EXPECT_TRUE(b->receive(loop::Clock::now() + 60s));
  sender.join();
}

}  // namespace
}  // namespace tachless::bus
