#include "bus/authenticated.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/support/in_memory.h"

using namespace tachless;

namespace {

using Bytes = std::vector<std::byte>;

bus::Key key_of(unsigned char seed) {
  bus::Key key;
  for (std::size_t i = 0; i < bus::Key::size; ++i) {
    key.bytes()[i] = static_cast<unsigned char>(seed + 3 * i);
  }
  return key;
}

Bytes announcement() {
  messages::Participant who;
  who.instance = 5;
  who.role = messages::Role::controller;
  who.host = "arm-1";
  messages::Codec<messages::Participant> codec(messages::Layout{});
  const auto bytes = codec.encode({0, 7, -1}, who);
  return {bytes.begin(), bytes.end()};
}

constexpr messages::PerRole roster = {99, 100, 101, 102};

class AnAuthenticatedBus : public testing::Test {
 protected:
  void SetUp() override {
    for (bus::Authenticated* each : {&alice, &bob}) {
      for (const char* channel : {"ARM_COMMAND", "ARM_POSITION", "ARM_PARTICIPANT"}) {
        each->subscribe(channel);
      }
    }
    for (const char* channel : {"ARM_COMMAND", "ARM_POSITION", "ARM_PARTICIPANT"}) {
      listener->subscribe(channel);
    }
  }

  static std::optional<Bytes> heard(bus::Transport& by) {
    const auto datagram = by.receive(base::Clock::time_point::min());
    if (!datagram) return std::nullopt;
    return Bytes(datagram->payload.begin(), datagram->payload.end());
  }

  bus::InMemoryNetwork network;
  std::unique_ptr<bus::Transport> listener = network.connect("a stranger");
  std::unique_ptr<bus::Transport> at_alice = network.connect("alice");
  std::unique_ptr<bus::Transport> at_bob = network.connect("bob");
  bus::Authenticated alice{*at_alice, key_of(1)};
  bus::Authenticated bob{*at_bob, key_of(1)};
  Bytes payload = Bytes(100, std::byte{42});
};

TEST_F(AnAuthenticatedBus, CarriesWhatItsOwnSayAndTakesTheTagOff) {
  alice.enter(7, roster);
  bob.enter(7, roster);
  alice.publish("ARM_COMMAND", payload);
  EXPECT_EQ(heard(bob), payload);
  EXPECT_EQ(heard(*listener)->size(), payload.size() + bus::tag_size);
  EXPECT_EQ(bob.dropped(), 0);
}

TEST_F(AnAuthenticatedBus, CarriesAnnouncementsBeforeTheSession) {
  alice.publish("ARM_PARTICIPANT", announcement());
  EXPECT_EQ(heard(bob), announcement());
  EXPECT_THROW(alice.publish("ARM_COMMAND", payload), std::logic_error);
}

TEST_F(AnAuthenticatedBus, DropsAMessageInWhichAnyOneBitIsFlipped) {
  alice.enter(7, roster);
  bob.enter(7, roster);
  alice.publish("ARM_COMMAND", payload);
  const Bytes sound = *heard(*listener);
  heard(bob);
  for (std::size_t bit = 0; bit < 8 * sound.size(); ++bit) {
    Bytes bent = sound;
    bent[bit / 8] ^= std::byte{1} << (bit % 8);
    listener->publish("ARM_COMMAND", bent);
    EXPECT_EQ(heard(bob), std::nullopt) << bit;
  }
  EXPECT_EQ(bob.dropped(), static_cast<std::int64_t>(8 * sound.size()));
}

TEST_F(AnAuthenticatedBus, DropsWhatIsCutOrHasNoTagOrCameOnAnotherChannel) {
  alice.enter(7, roster);
  bob.enter(7, roster);
  alice.publish("ARM_COMMAND", payload);
  const Bytes sound = *heard(*listener);
  heard(bob);
  for (std::size_t size = 0; size < sound.size(); ++size) {
    listener->publish("ARM_COMMAND", std::span(sound).first(size));
    EXPECT_EQ(heard(bob), std::nullopt) << size;
  }
  listener->publish("ARM_POSITION", sound);
  EXPECT_EQ(heard(bob), std::nullopt);
  listener->publish("ARM_COMMAND", sound);
  EXPECT_EQ(heard(bob), payload) << "the same session's copy";
}

TEST_F(AnAuthenticatedBus, DropsWhatWasSaidInAnotherSessionAlsoOfTheSameRun) {
  alice.enter(7, roster);
  alice.publish("ARM_COMMAND", payload);
  const Bytes earlier = *heard(*listener);
  EXPECT_EQ(heard(bob), std::nullopt) << "before it has a session";
  bob.enter(8, roster);
  listener->publish("ARM_COMMAND", earlier);
  EXPECT_EQ(heard(bob), std::nullopt);
  for (std::size_t role = 0; role < roster.size(); ++role) {
    messages::PerRole other = roster;
    ++other[role];
    bob.enter(7, other);
    listener->publish("ARM_COMMAND", earlier);
    EXPECT_EQ(heard(bob), std::nullopt) << "the key depends on all four: " << role;
  }
  bob.enter(7, roster);
  listener->publish("ARM_COMMAND", earlier);
  EXPECT_EQ(heard(bob), payload);
}

TEST_F(AnAuthenticatedBus, TellsAParticipantWithAnotherKeyFromOneWithoutAndFromGarbage) {
  auto other_end = network.connect("carol");
  bus::Authenticated carol(*other_end, key_of(2));
  carol.publish("ARM_PARTICIPANT", announcement());
  EXPECT_EQ(heard(bob), std::nullopt);
  auto stranger = bob.take_stranger();
  ASSERT_TRUE(stranger);
  EXPECT_TRUE(stranger->tagged);
  EXPECT_EQ(stranger->who.host, "arm-1");
  EXPECT_FALSE(bob.take_stranger());

  listener->publish("ARM_PARTICIPANT", announcement());
  EXPECT_EQ(heard(bob), std::nullopt);
  stranger = bob.take_stranger();
  ASSERT_TRUE(stranger);
  EXPECT_FALSE(stranger->tagged);
  EXPECT_EQ(stranger->sender, "a stranger");

  listener->publish("ARM_PARTICIPANT", payload);
  EXPECT_EQ(heard(bob), std::nullopt);
  EXPECT_FALSE(bob.take_stranger());
}

TEST_F(AnAuthenticatedBus, RefusesAMessageThatDoesNotFitWithItsTag) {
  alice.enter(7, roster);
  EXPECT_THROW(alice.publish("ARM_COMMAND", Bytes(65'499)), std::length_error);
}

TEST_F(AnAuthenticatedBus, LooksUpDuringAFlood) {
  for (int i = 0; i < 1000; ++i) listener->publish("ARM_PARTICIPANT", payload);
  alice.publish("ARM_PARTICIPANT", announcement());
  int calls = 1;
  while (!heard(bob)) ++calls;
  EXPECT_GT(calls, 10);
  EXPECT_EQ(bob.dropped(), 1000);
}

TEST_F(AnAuthenticatedBus, WaitsUntilItsDeadlineInAFlood) {
  for (int i = 0; i < 1000; ++i) listener->publish("ARM_PARTICIPANT", payload);
  alice.publish("ARM_PARTICIPANT", announcement());
  // Longer than a thousand datagrams take on any machine.
  EXPECT_TRUE(bob.receive(base::Clock::now() + std::chrono::minutes(1)));
  EXPECT_EQ(bob.dropped(), 1000);
}

}  // namespace
