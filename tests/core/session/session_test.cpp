#include "session/session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/failure.h"
#include "tests/support/in_memory.h"

namespace tachless::session {
namespace {

using namespace std::chrono_literals;
using session::Receipt;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;
using Time = base::Clock::time_point;

constexpr Time start{1h};

messages::Participant the_plant() {
  messages::Participant plant;
  plant.role = messages::Role::plant;
  plant.pid = 42;
  plant.host = "arm-1";
  return plant;
}

/// Returns the message that `check` throws at `at`, after `number` announcements at `start`; empty
/// if it does not throw.
std::string complaint(KeyCheck check, bool tagged, int number, Time at) {
  for (int i = 0; i < number; ++i) check.on_foreign({tagged, the_plant(), "10.0.0.2:4123"}, start);
  try {
    check.poll(at);
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::protocol_violated);
    return failure.what();
  }
  return {};
}

TEST(KeyCheck, NamesTheProcessWithTheOtherKeyAndTheRemedy) {
  const KeyCheck with_key(messages::Role::controller, true);
  EXPECT_THAT(complaint(with_key, true, 5, start + 1500ms),
              AllOf(HasSubstr("the plant (process 42 on arm-1, 10.0.0.2:4123)"),
                    HasSubstr("has another key than this controller;"), HasSubstr("--key-file")));
  EXPECT_THAT(complaint(with_key, false, 5, start + 1500ms),
              HasSubstr("has no key, this controller has one;"));
  EXPECT_THAT(complaint(KeyCheck(messages::Role::controller, false), true, 5, start + 2s),
              HasSubstr("has a key, this controller has none;"));
}

TEST(KeyCheck, NeedsFiveAnnouncementsAndOneAndAHalfSeconds) {
  const KeyCheck check(messages::Role::controller, true);
  EXPECT_EQ(complaint(check, true, 0, start + 10s), "");
  EXPECT_EQ(complaint(check, true, 4, start + 10s), "");
  EXPECT_EQ(complaint(check, true, 5, start + 1499ms), "");
  EXPECT_NE(complaint(check, true, 5, start + 1500ms), "");
}

TEST(KeyCheck, IsContentOnceAnAnnouncementHasVerified) {
  KeyCheck check(messages::Role::controller, true);
  check.on_verified();
  EXPECT_EQ(complaint(check, true, 100, start + 1h), "");
}

TEST(KeyCheck, HintsAtAForeignOneAlsoWhenOthersHaveVerified) {
  KeyCheck check(messages::Role::controller, true);
  EXPECT_EQ(check.hint(), "");
  check.on_verified();
  check.on_foreign({true, the_plant(), "10.0.0.2:4123"}, start);
  EXPECT_EQ(check.hint(),
            "; the plant (process 42 on arm-1, 10.0.0.2:4123) has another key than this controller "
            "(--key-file)");
}

/// A session that waits for the others, and another process on its channel.
class ALink : public testing::Test {
 protected:
  ALink() {
    session_.on_announcement([this](const bus::Datagram&) { ++recorded_; });
    other_->subscribe("ARM_PARTICIPANT");
  }

  static scenario::Scenario scenario() {
    scenario::Scenario scenario;
    scenario.robot.channel_prefix = "ARM";
    scenario.loop.give_up_s = 5;
    return scenario;
  }
  static Session::Config config() {
    Session::Config config;
    config.role = messages::Role::logger;
    config.instance = 4;
    return config;
  }
  void send(std::span<const std::byte> payload) {
    other_->publish("ARM_PARTICIPANT", payload);
    EXPECT_TRUE(session_.receive(Time()));
  }
  /// Announces the plant of run 7, with the address "other".
  void join_the_plant() {
    session_.poll(base::Clock::now());
    const auto asked = other_->receive(Time());
    ASSERT_TRUE(asked);
    messages::Stamp stamp;
    messages::Participant logger;
    ASSERT_EQ(codec_.decode(asked->payload, stamp, logger), messages::Rejection::none);
    messages::Participant plant = the_plant();
    plant.instance = 1;
    plant.counter = 1;
    plant.heard_instance = {0, 0, 0, logger.instance};
    plant.heard_counter = {0, 0, 0, logger.counter};
    send(codec_.encode({0, 7, -1}, plant));
  }
  /// Returns what a conflict between two messages for tick 5 throws.
  std::string conflict(messages::Role from, const bus::Datagram& second) {
    try {
      session_.count(Receipt::conflicting, from, second, 5);
    } catch (const base::Failure& failure) {
      EXPECT_EQ(failure.code(), base::ExitCode::protocol_violated);
      return failure.what();
    }
    return {};
  }

  bus::InMemoryNetwork network_;
  std::unique_ptr<bus::Transport> own_ = network_.connect("own");
  std::unique_ptr<bus::Transport> other_ = network_.connect("other");
  scenario::Scenario scenario_ = scenario();
  Session session_{scenario_, *own_, config()};
  messages::Codec<messages::Participant> codec_{messages::Layout{}};
  int recorded_ = 0;
};

TEST_F(ALink, ShowsNothingThatDoesNotDecodeToTheHandlerOfAnnouncements) {
  send(std::vector<std::byte>(60'000, std::byte{0x5a}));
  send({});
  EXPECT_EQ(recorded_, 0);
  EXPECT_EQ(session_.statistics().rejected.total(), 2);
}

TEST_F(ALink, NamesAProcessWithAnotherKeyWhenItHasWaitedInVain) {
  Session::Config hurried = config();
  hurried.wait_s = 0.05;
  const auto own = network_.connect("hurried");
  Session session(scenario_, *own, hurried);
  const auto bytes = codec_.encode({1, 7, -1}, the_plant());
  std::vector<std::byte> tagged(bytes.begin(), bytes.end());
  tagged.resize(tagged.size() + bus::tag_size);
  other_->publish("ARM_PARTICIPANT", tagged);
  try {
    session.join({}, {});
    FAIL() << "joined alone";
  } catch (const base::Failure& failure) {
    EXPECT_EQ(failure.code(), base::ExitCode::peer_lost);
    EXPECT_THAT(failure.what(), AllOf(HasSubstr("waited 0.05 s for plant, reference, controller"),
                                      HasSubstr("has a key, this logger has none (--key-file)")));
  }
}

TEST_F(ALink, ShowsNothingOfProcessesThatAreNoMembers) {
  messages::Participant other = the_plant();
  other.role = messages::Role::reference;
  other.instance = 11;
  for (other.counter = 1; other.counter <= 100; ++other.counter) {
    send(codec_.encode({0, 7, -1}, other));
  }
  EXPECT_EQ(recorded_, 0);
}

TEST_F(ALink, ShowsTheAnnouncementsOfThePlantThatItHasJoined) {
  join_the_plant();
  EXPECT_EQ(recorded_, 1);
  EXPECT_EQ(session_.run(), 7);
}

TEST_F(ALink, AnnouncesAHostNameWithControlCharactersAsText) {
  const auto announce_from_strange_host = [&] {
    const std::string name = "arm\x1b[31m";
    if (unshare(CLONE_NEWUSER | CLONE_NEWUTS) != 0 || sethostname(name.data(), name.size()) != 0) {
      std::perror("host name of a namespace");
      std::exit(2);
    }
    Session session(scenario_, *own_, config());
    session.poll(base::Clock::now());
    messages::Stamp stamp;
    messages::Participant logger;
    const auto sent = other_->receive(Time());
    const bool decoded =
        sent && codec_.decode(sent->payload, stamp, logger) == messages::Rejection::none;
    std::exit(decoded && logger.host == "arm?[31m" ? 0 : 1);
  };
  EXPECT_EXIT(announce_from_strange_host(), testing::ExitedWithCode(0), "");
}

TEST_F(ALink, DeliversAMessageToTheHandlerOfItsChannel) {
  std::vector<std::string> seen;
  session_.on("A", [&](const bus::Datagram&) { seen.emplace_back("a"); });
  session_.on("B", [&](const bus::Datagram&) { seen.emplace_back("b"); });
  session_.on("ARM_PARTICIPANT", [&](const bus::Datagram&) { seen.emplace_back("other"); });
  for (const char* channel : {"B", "A", "C", "ARM_PARTICIPANT"}) other_->publish(channel, {});
  while (session_.receive(Time())) {
  }
  EXPECT_THAT(seen, ElementsAre("b", "a"));
}

TEST_F(ALink, CountsWhatIsNotFresh) {
  for (const Receipt receipt : {Receipt::fresh, Receipt::repeated, Receipt::repeated,
                                Receipt::not_asked, Receipt::too_old}) {
    session_.count(receipt);
  }
  EXPECT_EQ(session_.statistics().duplicates, 2);
  std::map<std::string_view, std::int64_t> dropped;
  for (const auto& [reason, count] : session_.statistics().rejected.entries()) {
    if (count != 0) dropped[reason] = count;
  }
  EXPECT_THAT(dropped, ElementsAre(Pair("not_asked", 1), Pair("too_old", 1)));
}

TEST_F(ALink, FailsWhenTwoProcessesHaveOneRole) {
  const bus::Datagram second{"ARM_COMMAND", {}, "10.0.0.3:1"};
  EXPECT_NO_THROW(session_.count(Receipt::repeated, messages::Role::controller, second, 5));
  EXPECT_THAT(conflict(messages::Role::controller, second),
              AllOf(HasSubstr("two processes are the controller of run"), HasSubstr("tick 5"),
                    HasSubstr("ARM_COMMAND, one of them from 10.0.0.3:1"),
                    HasSubstr("the controller, end")));
}

TEST_F(ALink, NamesTheOtherOfTwoProcessesAlsoWhenItWasFirst) {
  join_the_plant();
  const bus::Datagram strange{"ARM_POSITION", {}, "10.0.0.3:1"}, own{"ARM_POSITION", {}, "other"};
  session_.count(Receipt::fresh, messages::Role::plant, strange, 5);
  EXPECT_THAT(conflict(messages::Role::plant, own),
              AllOf(HasSubstr("one of them from 10.0.0.3:1; the run's own is the plant"),
                    HasSubstr("other)")));
}

TEST_F(ALink, NotesWhateverEndsItInTheStatistics) {
  EXPECT_THROW(session_.guard([] { throw 42; }), base::Failure);
  EXPECT_EQ(session_.statistics().exit_code, base::ExitCode::protocol_violated);
}

}  // namespace
}  // namespace tachless::session
