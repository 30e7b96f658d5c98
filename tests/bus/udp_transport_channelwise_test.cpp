#include "bus/udp_transport.h"

#include <gmock/gmock.h>

#include <array>
#include <chrono>
#include <cstring>
#include <random>
#include <string>
#include <thread>

#include "tests/support/counting_new.h"
#include "tests/support/private_network.h"

namespace tachless::bus {
namespace {

using namespace std::chrono_literals;

loop::Clock::time_point soon() { return loop::Clock::now() + 5s; }

constexpr std::array channels = {"A", "B", "C", "D", "E", "F"};

/// Sends numbered messages, each on a channel drawn by a seed.
class Talker {
 public:
  explicit Talker(const std::string& url) : transport_(url) {}
  void say(int count) {
    for (int i = 0; i < count; ++i) {
      const std::uint32_t number = next_++;
      transport_.publish(channels[random_() % channels.size()],
                         std::as_bytes(std::span(&number, 1)));
    }
  }

 private:
  UdpTransport transport_;
  std::mt19937 random_{3};
  std::uint32_t next_ = 0;
};

std::uint32_t number_in(const Datagram& datagram) {
  std::uint32_t number = 0;
  std::memcpy(&number, datagram.payload.data(), sizeof number);
  return number;
}

/// The kernel begins to stamp some time after it was first asked to; before, it stamps what is
/// read.
void wait_until_the_kernel_stamps(const std::string& url) {
  UdpTransport from(url);
  UdpTransport to(url);
  to.stamp_arrivals();
  to.subscribe("STAMPED");
  for (;;) {
    from.publish("STAMPED", {});
    std::this_thread::sleep_for(1ms);
    const auto read_at = std::chrono::system_clock::now().time_since_epoch();
    const auto raw = to.receive(soon());
    if (raw && std::chrono::nanoseconds(raw->received_ns) < read_at) return;
  }
}

/// Hears all channels, given this much buffer for each.
class Listener {
 public:
  explicit Listener(const std::string& url) : sender_(url), transport_(sender_) {
    for (const char* channel : channels) transport_.subscribe(channel);
    wait_until_the_kernel_stamps(url);
  }
  ChannelwiseTransport& operator*() { return transport_; }
  ChannelwiseTransport* operator->() { return &transport_; }

 private:
  UdpTransport sender_;
  ChannelwiseTransport transport_;
};

constexpr const char* small = "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=212992";

TEST(ChannelwiseTransport, HoldsTwoThousandMessagesInSmallBuffersAndYieldsThemInOrder) {
  Listener listener(small);
  UdpTransport one_socket(small);
  for (const char* channel : channels) one_socket.subscribe(channel);
  Talker talker(small);
  talker.say(2'000);
  for (std::uint32_t i = 0; i < 2'000; ++i) {
    const auto datagram = listener->receive(loop::Clock::now());
    ASSERT_TRUE(datagram) << i;
    ASSERT_EQ(number_in(*datagram), i);
  }
  EXPECT_FALSE(listener->receive(loop::Clock::now()));
  int in_one_socket = 0;
  while (one_socket.receive(loop::Clock::now())) ++in_one_socket;
  EXPECT_LT(in_one_socket, 2'000) << "else there is no need for this class";
}

TEST(ChannelwiseTransport, YieldsInOrderWhatComesWhileItListens) {
  Listener listener(small);
  Talker talker(small);
  std::thread talking([&] {
    for (int i = 0; i < 200; ++i) {
      talker.say(10);
      std::this_thread::sleep_for(200us);
    }
  });
  std::uint32_t in_order = 0;
  for (std::uint32_t i = 0; i < 2'000; ++i) {
    const auto datagram = listener->receive(soon());
    if (!datagram) break;
    if (number_in(*datagram) == i) ++in_order;
  }
  talking.join();
  EXPECT_EQ(in_order, 2'000U);
}

TEST(ChannelwiseTransport, WaitsUntilTheDeadlineAndNoLonger) {
  Listener listener(small);
  const auto begin = loop::Clock::now();
  EXPECT_FALSE(listener->receive(begin + 20ms));
  EXPECT_GE(loop::Clock::now() - begin, 20ms);
}

TEST(ChannelwiseTransport, DoesNotWaitWhileThereAreMessages) {
  UdpTransport sender;
  UdpTransport from;
  ChannelwiseTransport to(sender);
  to.subscribe("A");
  constexpr int messages = 40;  // more than one reading of the socket takes
  for (int i = 0; i < messages; ++i) from.publish("A", {});
  const auto start = loop::Clock::now();
  for (int i = 0; i < messages; ++i) ASSERT_TRUE(to.receive(start + 60s)) << i;
  EXPECT_LT(loop::Clock::now() - start, 10s);
}
TEST(ChannelwiseTransport, DoesNotHearItselfButIsHeard) {
  Listener listener(small);
  UdpTransport other(small);
  other.subscribe("A");
  const std::array payload = {std::byte{5}};
  listener->publish("A", payload);
  EXPECT_FALSE(listener->receive(loop::Clock::now() + 20ms));
  EXPECT_TRUE(other.receive(soon()));
}

TEST(ChannelwiseTransport, AllocatesNothingPerMessage) {
  Listener listener(small);
  Talker talker(small);
  talker.say(300);
  for (int i = 0; i < 100; ++i) ASSERT_TRUE(listener->receive(loop::Clock::now()));
  const std::size_t before = allocations;
  for (int i = 0; i < 200; ++i) ASSERT_TRUE(listener->receive(loop::Clock::now()));
  EXPECT_EQ(allocations, before);
}

}  // namespace
}  // namespace tachless::bus
