#include "tests/soak/impostor.h"

#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <vector>

#include "node/options.h"
#include "tests/support/private_network.h"

namespace tachless::soak {
namespace {

using namespace std::chrono_literals;
using loop::Clock;

const std::vector<std::byte> message(40, std::byte{1});

TEST(AnImpostor, SpeaksFromAMembersAddressOnceItHasHeardItAndNeverHearsItself) {
  bus::UdpTransport logger(node::default_lcm_url);
  bus::UdpTransport other(node::default_lcm_url);
  Impostor impostor("logger's endpoint");
  for (bus::Transport* each :
       {static_cast<bus::Transport*>(&other), static_cast<bus::Transport*>(&impostor)}) {
    each->subscribe("ARM_PARTICIPANT");
    each->subscribe("ARM_LOG_ACK");
  }
  impostor.publish("ARM_LOG_ACK", message);
  const auto stranger = other.receive(Clock::now() + 5s);
  ASSERT_TRUE(stranger);
  const std::string before(stranger->sender);

  loop::Participant who;
  who.role = loop::Role::logger;
  bus::Codec<loop::Participant> codec{loop::Layout{}};
  logger.publish("ARM_PARTICIPANT", codec.encode({0, 7, -1}, who));
  const auto honest = other.receive(Clock::now() + 5s);
  ASSERT_TRUE(honest);
  const std::string address(honest->sender);
  EXPECT_NE(address, before);
  ASSERT_TRUE(impostor.receive(Clock::now() + 5s));

  impostor.publish("ARM_LOG_ACK", message);
  const auto forged = other.receive(Clock::now() + 5s);
  ASSERT_TRUE(forged);
  EXPECT_EQ(forged->sender, address);
  EXPECT_EQ(forged->channel, "ARM_LOG_ACK");
  EXPECT_TRUE(std::ranges::equal(forged->payload, message));
  EXPECT_FALSE(impostor.receive(Clock::now() + 50ms));
}

}  // namespace
}  // namespace tachless::soak
