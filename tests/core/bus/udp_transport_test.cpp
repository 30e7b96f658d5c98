#include "bus/udp_transport.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstring>
#include <lcm/lcm-cpp.hpp>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/counting_new.h"
#include "tests/support/private_network.h"

namespace tachless::bus {
namespace {

using namespace std::chrono_literals;

std::span<const std::byte> bytes(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}
std::string text(const Datagram& datagram) {
  return {reinterpret_cast<const char*>(datagram.payload.data()), datagram.payload.size()};
}

/// Returns the deadline for expected messages. Loopback delivers before `sendmsg` returns; the rest
/// is for a busy machine.
base::Clock::time_point soon() { return base::Clock::now() + 5s; }
/// Returns the deadline for messages that must not come: they were delivered or dropped before.
base::Clock::time_point now() { return base::Clock::now(); }

/// Sends arbitrary bytes to a bus.
class Raw {
 public:
  explicit Raw(const LcmUrl& url) : fd_(::socket(AF_INET, SOCK_DGRAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(url.port);
    inet_pton(AF_INET, url.group.c_str(), &address.sin_addr);
    EXPECT_EQ(::connect(fd_.get(), reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  }
  void send(const std::string& packet) const {
    EXPECT_EQ(::send(fd_.get(), packet.data(), packet.size(), 0),
              static_cast<ssize_t>(packet.size()));
  }

 private:
  base::FileDescriptor fd_;
};

TEST(UdpTransport, CarriesAMessageToAnother) {
  UdpTransport a;
  UdpTransport b;
  b.subscribe("ARM_TICK");
  a.publish("ARM_TICK", bytes("hello"));
  const auto got = b.receive(soon());
  ASSERT_TRUE(got);
  EXPECT_EQ(got->channel, "ARM_TICK");
  EXPECT_EQ(text(*got), "hello");
  EXPECT_THAT(std::string(got->sender), testing::MatchesRegex("localhost:[0-9]+"));
  EXPECT_FALSE(b.receive(now()));
  EXPECT_EQ(b.statistics().received, 1U);
}
TEST(UdpTransport, CarriesAnEmptyMessage) {
  UdpTransport a;
  UdpTransport b;
  b.subscribe("E");
  a.publish("E", {});
  const auto got = b.receive(soon());
  ASSERT_TRUE(got);
  EXPECT_EQ(got->payload.size(), 0U);
}
TEST(UdpTransport, YieldsSubscribedChannelsOnly) {
  UdpTransport a;
  UdpTransport b;
  b.subscribe("ARM_POSITION");
  b.subscribe("ARM_TICK");
  b.subscribe("ARM_TICK");
  for (const char* channel : {"ARM_TICKS", "ARM_TIC", "ARM_STATE", "ARM_POSITION2"}) {
    a.publish(channel, bytes("x"));
  }
  a.publish("ARM_TICK", bytes("1"));
  a.publish("ARM_POSITION", bytes("2"));
  EXPECT_EQ(b.receive(soon())->channel, "ARM_TICK");
  EXPECT_EQ(b.receive(soon())->channel, "ARM_POSITION");
  EXPECT_FALSE(b.receive(now()));
}
TEST(UdpTransport, SendsWithTheTtlOfItsUrl) {
  UdpTransport listener;  // keeps the group joined
  const base::FileDescriptor fd(::socket(AF_INET, SOCK_DGRAM, 0));
  const int on = 1;
  ::setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  ::setsockopt(fd.get(), SOL_SOCKET, SO_REUSEPORT, &on, sizeof on);
  ::setsockopt(fd.get(), IPPROTO_IP, IP_RECVTTL, &on, sizeof on);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(listener.url().port);
  ASSERT_EQ(::bind(fd.get(), reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  for (const int ttl : {0, 1, 3}) {
    UdpTransport(parse_lcm_url("udpm://?ttl=" + std::to_string(ttl))).publish("C", {});
    std::array<char, 64> data{};
    alignas(cmsghdr) std::array<char, 64> control{};
    iovec part{data.data(), data.size()};
    msghdr message{};
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    ASSERT_GT(::recvmsg(fd.get(), &message, MSG_DONTWAIT), 0);
    const cmsghdr* extra = CMSG_FIRSTHDR(&message);
    ASSERT_NE(extra, nullptr);
    int got = -1;
    std::memcpy(&got, CMSG_DATA(extra), sizeof got);
    EXPECT_EQ(got, ttl);
  }
}
TEST(UdpTransport, KeepsNothingFromBeforeTheSubscription) {
  UdpTransport a;
  UdpTransport b;
  a.publish("ARM_TICK", bytes("early"));
  b.subscribe("ARM_TICK");
  EXPECT_FALSE(b.receive(now()));
}
TEST(UdpTransport, DoesNotReceiveItsOwnMessages) {
  UdpTransport a;
  a.subscribe("ARM_PARTICIPANT");
  a.publish("ARM_PARTICIPANT", bytes("me"));
  EXPECT_FALSE(a.receive(now()));
  EXPECT_EQ(a.statistics().own, 1U);
  UdpTransport b;
  b.publish("ARM_PARTICIPANT", bytes("you"));
  const auto got = a.receive(soon());
  ASSERT_TRUE(got);
  EXPECT_EQ(text(*got), "you");
}
TEST(UdpTransport, TellsSendersApart) {
  UdpTransport receiver;
  receiver.subscribe("C");
  std::vector<std::string> names;
  for (int i = 0; i < 12; ++i) {  // more than the transport remembers
    UdpTransport sender;
    sender.publish("C", {});
    const auto got = receiver.receive(soon());
    ASSERT_TRUE(got);
    names.emplace_back(got->sender);
  }
  std::sort(names.begin(), names.end());
  EXPECT_EQ(std::unique(names.begin(), names.end()), names.end());
}
TEST(UdpTransport, KeepsToItsDeadline) {
  UdpTransport a;
  a.subscribe("C");
  const auto start = base::Clock::now();
  EXPECT_FALSE(a.receive(start + 30ms));
  EXPECT_GE(base::Clock::now(), start + 30ms);
  EXPECT_FALSE(a.receive(start - 1h));
  EXPECT_FALSE(a.receive(base::Clock::time_point::min()));
}
TEST(UdpTransport, KeepsGroupsOnOnePortApart) {
  UdpTransport a(parse_lcm_url("udpm://239.1.1.1:7700"));
  UdpTransport b(parse_lcm_url("udpm://239.1.1.2:7700"));
  UdpTransport to_a(parse_lcm_url("udpm://239.1.1.1:7700"));
  a.subscribe_all();
  b.subscribe_all();
  to_a.publish("C", bytes("for a"));
  EXPECT_TRUE(a.receive(soon()));
  EXPECT_FALSE(b.receive(now()));
}
TEST(UdpTransport, KeepsPortsOfOneGroupApart) {
  UdpTransport a(parse_lcm_url("udpm://:7701"));
  UdpTransport b(parse_lcm_url("udpm://:7702"));
  b.subscribe_all();
  a.publish("C", {});
  EXPECT_FALSE(b.receive(now()));
}

TEST(UdpTransport, CarriesTheLargestDatagramAndRefusesALargerOne) {
  UdpTransport a;
  UdpTransport b;
  b.subscribe("C");
  const std::string largest(65'499 - 2, 'x');
  a.publish("C", bytes(largest));
  const auto got = b.receive(soon());
  ASSERT_TRUE(got);
  EXPECT_EQ(text(*got), largest);
  EXPECT_THROW(a.publish("C", bytes(largest + "x")), std::length_error);
}
TEST(UdpTransport, RefusesImpossibleChannelNames) {
  UdpTransport a;
  const std::string longest(63, 'c');
  EXPECT_NO_THROW(a.subscribe(longest));
  EXPECT_NO_THROW(a.publish(longest, {}));
  for (const std::string& name : {std::string(), std::string(64, 'c'), std::string("a\0b", 3)}) {
    EXPECT_THROW(a.subscribe(name), std::invalid_argument);
    EXPECT_THROW(a.publish(name, {}), std::invalid_argument);
  }
}

TEST(UdpTransport, GivesAMonitorEveryChannelWithSequenceAndTime) {
  UdpTransport a;
  UdpTransport monitor;
  monitor.subscribe_all();
  constexpr std::array<const char*, 3> channels = {"TICK", "POSITION", "TICK"};
  for (const char* channel : channels) a.publish(channel, bytes("x"));
  std::int64_t last_ns = 0;
  for (std::uint32_t i = 0; i < 3; ++i) {
    const auto got = monitor.receive(soon());
    ASSERT_TRUE(got);
    EXPECT_EQ(got->channel, channels[i]);
    EXPECT_EQ(got->sequence, i);
    EXPECT_GE(got->received_ns, last_ns);
    last_ns = got->received_ns;
  }
  const auto clock = std::chrono::system_clock::now().time_since_epoch();
  EXPECT_LT(std::chrono::abs(clock - std::chrono::nanoseconds(last_ns)), 5s);
}
TEST(UdpTransport, CountsMalformedDatagrams) {
  UdpTransport monitor;
  monitor.subscribe_all();
  const Raw raw(monitor.url());
  const std::string header = std::string("LC02") + std::string(4, '\0');
  raw.send("");
  raw.send("LC02");
  raw.send(header);
  raw.send(header + "NO_NUL");
  raw.send(header + std::string(1, '\0') + "payload of a channel without name");
  raw.send(header + std::string(64, 'c') + std::string(1, '\0'));
  raw.send("XXXX" + std::string(4, '\0') + std::string("C\0", 2));
  raw.send("LC03" + std::string(4, '\0'));
  EXPECT_FALSE(monitor.receive(now()));
  EXPECT_EQ(monitor.statistics().malformed, 8U);
  raw.send(header + std::string("C\0", 2) + "good");
  EXPECT_EQ(text(*monitor.receive(soon())), "good");
}
TEST(UdpTransport, CountsWhatItsBufferCouldNotHold) {
  UdpTransport a;
  UdpTransport monitor(parse_lcm_url("udpm://?recv_buf_size=20000"));
  EXPECT_EQ(monitor.receive_buffer_bytes(), 20'000);
  monitor.subscribe_all();
  const std::string payload(1000, 'x');
  for (int i = 0; i < 200; ++i) a.publish("C", bytes(payload));
  while (monitor.receive(now())) {
  }
  const BusStatistics statistics = monitor.statistics();
  ASSERT_TRUE(statistics.overflowed);
  EXPECT_GT(*statistics.overflowed, 0U);
  EXPECT_EQ(statistics.received + *statistics.overflowed, 200U);
}
TEST(UdpTransport, DoesNotTellWhatItsBufferCouldNotHoldWhereItsFilterHidesIt) {
  UdpTransport a;
  UdpTransport b(parse_lcm_url("udpm://?recv_buf_size=20000"));
  b.subscribe("C");
  const std::string payload(1000, 'x');
  for (int i = 0; i < 200; ++i) a.publish("C", bytes(payload));
  for (int i = 0; i < 200; ++i) a.publish("OTHER", bytes(payload));
  while (b.receive(now())) {
  }
  const BusStatistics statistics = b.statistics();
  EXPECT_FALSE(statistics.overflowed);
  EXPECT_LT(statistics.received, 200U);
}
TEST(UdpTransport, CountsWhatTheKernelDidNotTake) {
  UdpTransport a;
  ASSERT_EQ(std::system("nft 'add table ip t; add chain ip t out {type filter hook output priority "
                        "0;}; add rule ip t out udp dport 7667 drop'"),
            0);
  a.publish("C", {});
  EXPECT_EQ(a.statistics().unsent, 1U);
  ASSERT_EQ(std::system("nft delete table ip t"), 0);
  a.publish("C", {});
  EXPECT_EQ(a.statistics().unsent, 1U);
}

volatile sig_atomic_t signals = 0;

TEST(UdpTransport, ASignalThatIsHandledEndsAWait) {
  struct sigaction action {};
  action.sa_handler = [](int) { signals = signals + 1; };
  ASSERT_EQ(::sigaction(SIGTERM, &action, nullptr), 0);
  UdpTransport a;
  a.subscribe("C");
  const pthread_t waiting = ::pthread_self();
  // A signal before the wait does not end the wait, so the test repeats it until one does.
  const std::jthread sender([&](const std::stop_token& over) {
    for (; !over.stop_requested(); std::this_thread::sleep_for(1ms)) {
      ::pthread_kill(waiting, SIGTERM);
    }
  });
  const auto start = base::Clock::now();
  EXPECT_FALSE(a.receive(start + 60s));
  EXPECT_LT(base::Clock::now() - start, 30s);
  EXPECT_GT(signals, 0);
}
TEST(UdpTransport, ReadsInBatchesAndKeepsToItsDeadline) {
  UdpTransport a;
  UdpTransport b;
  b.subscribe("C");
  b.read_in_batches(20ms);
  const auto start = base::Clock::now();
  a.publish("C", bytes("first"));
  ASSERT_TRUE(b.receive(start + 60s));
  EXPECT_GE(base::Clock::now() - start, 20ms);
  for (int i = 0; i < 100; ++i) a.publish("C", bytes("more"));
  for (int i = 0; i < 100; ++i) ASSERT_TRUE(b.receive(start + 60s)) << i;
  EXPECT_FALSE(b.receive(now())) << "a deadline that has passed allows no pause";
  b.read_in_batches(1h);
  EXPECT_FALSE(b.receive(now() + 10ms));
  EXPECT_LT(base::Clock::now() - start, 60s);
}
TEST(UdpTransport, DoesNotOutstayItsDeadlineInAFloodOfItsOwnMessages) {
  UdpTransport a;
  a.subscribe("C");
  for (int i = 0; i < 300; ++i) a.publish("C", {});
  EXPECT_FALSE(a.receive(now()));
  EXPECT_LE(a.statistics().own, 64U);
}

TEST(UdpTransport, DoesNotAllocatePerMessage) {
  UdpTransport a;
  UdpTransport b;
  b.subscribe("ARM_POSITION");
  const auto exchange = [&] {
    a.publish("ARM_POSITION", bytes("payload"));
    return b.receive(base::Clock::now() + 5s).has_value();
  };
  ASSERT_TRUE(exchange());
  const std::size_t before = allocations;
  for (int i = 0; i < 100; ++i) {
    if (!exchange()) FAIL();
    if (b.receive(base::Clock::now())) FAIL();
  }
  EXPECT_EQ(allocations, before);
}

// These tests use liblcm on the other side.

struct Received {
  std::string channel;
  std::string payload;
};
void keep(const lcm_recv_buf_t* buffer, const char* channel, void* user) {
  static_cast<std::vector<Received>*>(user)->push_back(
      {channel, std::string(static_cast<const char*>(buffer->data), buffer->data_size)});
}

TEST(Interoperation, LiblcmHearsUs) {
  lcm::LCM theirs("udpm://239.255.76.67:7667?ttl=0");
  ASSERT_TRUE(theirs.good());
  std::vector<Received> received;
  lcm_subscribe(theirs.getUnderlyingLCM(), "ARM_.*", keep, &received);
  UdpTransport ours;
  const std::string large(60'000, 'y');
  ours.publish("ARM_TICK", bytes(std::string_view("a\0b", 3)));
  ours.publish("OTHER", bytes("no"));
  ours.publish("ARM_RUN_INFO", bytes(large));
  while (received.size() < 2) ASSERT_GT(theirs.handleTimeout(5000), 0);
  EXPECT_EQ(received[0].channel, "ARM_TICK");
  EXPECT_EQ(received[0].payload, std::string("a\0b", 3));
  EXPECT_EQ(received[1].channel, "ARM_RUN_INFO");
  EXPECT_EQ(received[1].payload, large);
}
TEST(Interoperation, WeHearLiblcm) {
  UdpTransport ours;
  ours.subscribe("ARM_TICK");
  lcm::LCM theirs("udpm://239.255.76.67:7667?ttl=0");
  ASSERT_TRUE(theirs.good());
  ASSERT_EQ(theirs.publish("ARM_TOCK", "no", 2), 0);
  ASSERT_EQ(theirs.publish("ARM_TICK", "a\0b", 3), 0);
  const auto got = ours.receive(soon());
  ASSERT_TRUE(got);
  EXPECT_EQ(got->channel, "ARM_TICK");
  EXPECT_EQ(text(*got), std::string("a\0b", 3));
}
TEST(Interoperation, CountsLiblcmsFragmentedMessagesOnce) {
  UdpTransport ours;
  UdpTransport monitor;
  ours.subscribe("BIG");
  monitor.subscribe_all();
  lcm::LCM theirs("udpm://239.255.76.67:7667?ttl=0");
  ASSERT_TRUE(theirs.good());
  const std::string big(200'000, 'b');
  ASSERT_EQ(theirs.publish("BIG", big.data(), static_cast<unsigned>(big.size())), 0);
  ASSERT_EQ(theirs.publish("OTHER_BIG", big.data(), static_cast<unsigned>(big.size())), 0);
  EXPECT_FALSE(ours.receive(now()));
  EXPECT_FALSE(monitor.receive(now()));
  EXPECT_EQ(ours.statistics().fragmented, 1U);
  EXPECT_EQ(monitor.statistics().fragmented, 2U);
}

}  // namespace
}  // namespace tachless::bus
