#include "node/link.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "diagnostics/failure.h"
#include "tests/support/in_memory.h"

namespace tachless::node {
namespace {

using namespace std::chrono_literals;
using ::testing::AllOf;
using ::testing::HasSubstr;
using Time = loop::Clock::time_point;

constexpr Time start{1h};

loop::Participant the_plant() {
  loop::Participant plant;
  plant.role = loop::Role::plant;
  plant.pid = 42;
  plant.host = "arm-1";
  return plant;
}

/// What `check` says at `at`, after `number` announcements at `start`; empty when it says nothing.
std::string said(KeyCheck check, bool tagged, int number, Time at) {
  for (int i = 0; i < number; ++i) check.foreign({tagged, the_plant(), "10.0.0.2:4123"}, start);
  try {
    check.poll(at);
  } catch (const diagnostics::Failure& failure) {
    EXPECT_EQ(failure.code(), diagnostics::ExitCode::protocol_violated);
    return failure.what();
  }
  return {};
}

TEST(KeyCheck, NamesTheProcessWithTheOtherKeyAndTheRemedy) {
  const KeyCheck with_key(loop::Role::controller, true);
  EXPECT_THAT(said(with_key, true, 5, start + 1500ms),
              AllOf(HasSubstr("the plant (process 42 on arm-1, 10.0.0.2:4123)"),
                    HasSubstr("has another key than this controller;"), HasSubstr("--key-file")));
  EXPECT_THAT(said(with_key, false, 5, start + 1500ms), HasSubstr("has no key, this controller;"));
  EXPECT_THAT(said(KeyCheck(loop::Role::controller, false), true, 5, start + 2s),
              HasSubstr("has a key, this controller has none;"));
}

TEST(KeyCheck, NeedsFiveAnnouncementsAndOneAndAHalfSeconds) {
  const KeyCheck check(loop::Role::controller, true);
  EXPECT_EQ(said(check, true, 0, start + 10s), "");
  EXPECT_EQ(said(check, true, 4, start + 10s), "");
  EXPECT_EQ(said(check, true, 5, start + 1499ms), "");
  EXPECT_NE(said(check, true, 5, start + 1500ms), "");
}

TEST(KeyCheck, IsContentOnceAnAnnouncementHasVerified) {
  KeyCheck check(loop::Role::controller, true);
  check.accepted();
  EXPECT_EQ(said(check, true, 100, start + 1h), "");
}

/// A link that waits for the others, and another process on its channel.
class ALink : public testing::Test {
 protected:
  ALink() {
    link_.on_session([this](const bus::Datagram&) { ++recorded_; });
    other_->subscribe("ARM_PARTICIPANT");
  }

  static experiment::Scenario scenario() {
    experiment::Scenario scenario;
    scenario.robot.channel_prefix = "ARM";
    scenario.loop.give_up_s = 5;
    return scenario;
  }
  static Link::Config config() {
    Link::Config config;
    config.role = loop::Role::logger;
    config.instance = 4;
    return config;
  }
  void send(std::span<const std::byte> payload) {
    other_->publish("ARM_PARTICIPANT", payload);
    EXPECT_TRUE(link_.receive(Time()));
  }

  bus::InMemoryNetwork network_;
  std::unique_ptr<bus::Transport> own_ = network_.connect("own");
  std::unique_ptr<bus::Transport> other_ = network_.connect("other");
  experiment::Scenario scenario_ = scenario();
  Link link_{scenario_, *own_, config()};
  bus::Codec<loop::Participant> codec_{loop::Layout{}};
  int recorded_ = 0;
};

TEST_F(ALink, ShowsNothingThatDoesNotDecodeToTheHandlerOfAnnouncements) {
  send(std::vector<std::byte>(60'000, std::byte{0x5a}));
  send({});
  EXPECT_EQ(recorded_, 0);
  EXPECT_EQ(link_.statistics().rejected.total(), 2);
}

TEST_F(ALink, ShowsNothingThatAnswersNoneOfItsAnnouncements) {
  loop::Participant old = the_plant();
  old.instance = 11;
  for (old.counter = 1; old.counter <= 100; ++old.counter) send(codec_.encode({0, 7, -1}, old));
  EXPECT_EQ(recorded_, 0);
}

TEST_F(ALink, ShowsTheAnnouncementsOfThePlantThatItHasJoined) {
  link_.poll(loop::Clock::now());
  const auto asked = other_->receive(Time());
  ASSERT_TRUE(asked);
  loop::Stamp stamp;
  loop::Participant logger;
  ASSERT_EQ(codec_.decode(asked->payload, stamp, logger), bus::Rejection::none);
  loop::Participant plant = the_plant();
  plant.instance = 1;
  plant.counter = 1;
  plant.heard_instance = {0, 0, 0, logger.instance};
  plant.heard_counter = {0, 0, 0, logger.counter};
  send(codec_.encode({0, 7, -1}, plant));
  EXPECT_EQ(recorded_, 1);
  EXPECT_EQ(link_.run(), 7);
}

}  // namespace
}  // namespace tachless::node
