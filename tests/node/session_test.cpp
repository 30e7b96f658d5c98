#include "node/session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "diagnostics/failure.h"
#include "tests/support/in_memory.h"

namespace tachless::node {
namespace {

using namespace std::chrono_literals;
using diagnostics::ExitCode;
using diagnostics::Failure;
using loop::Clock;
using protocol::lockstep::Verdict;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;

experiment::Scenario ten_ticks() {
  experiment::Scenario scenario;
  scenario.loop.num_ticks = 10;
  scenario.loop.give_up_s = 5;
  return scenario;
}

/// Playbacks are told the time; only `join` and `progressed` look at the clock themselves.
class Playing : public testing::Test {
 protected:
  void join(double wait_s) {
    playback_.emplace(ten_ticks(), *own_, 7, wait_s, &interrupted_);
    playback_->join({}, {});
    joined_ = Clock::now();
  }

  /// What `poll` says; empty when it says nothing.
  std::string said_after(std::chrono::nanoseconds passed, ExitCode code = ExitCode::peer_lost) {
    try {
      playback_->poll(joined_ + passed);
    } catch (const Failure& failure) {
      EXPECT_EQ(failure.code(), code);
      return failure.what();
    }
    return {};
  }

  bus::InMemoryNetwork network_;
  std::unique_ptr<bus::Transport> own_ = network_.connect("own");
  std::atomic<bool> interrupted_{false};
  std::optional<Playback> playback_;
  Clock::time_point joined_;
};

TEST_F(Playing, IsOverWithTheRunsLastTick) {
  join(0);
  EXPECT_EQ(playback_->run(), 7);
  EXPECT_FALSE(playback_->finished());
  playback_->progressed(8, 0);
  EXPECT_FALSE(playback_->finished());
  playback_->progressed(9, 0);
  EXPECT_TRUE(playback_->finished());
}

TEST_F(Playing, WaitsForTheFirstMessageAsLongAsItIsTold) {
  join(20);
  EXPECT_EQ(said_after(19s), "") << "longer than give_up_s, which is for a run that has begun";
  EXPECT_THAT(said_after(20s), AllOf(HasSubstr("run 7"), HasSubstr("tachless info LOG")));
  join(0);
  EXPECT_EQ(said_after(24h), "") << "0 is unlimited";
}

TEST_F(Playing, NamesTheTickAfterWhichTheRunStops) {
  join(0);
  playback_->progressed(3, 0);
  joined_ = Clock::now();
  EXPECT_EQ(said_after(4s), "");
  EXPECT_THAT(said_after(5s), HasSubstr("silent after tick 3 of 9"));
}

TEST_F(Playing, EndsWhenInterrupted) {
  join(0);
  interrupted_ = true;
  EXPECT_NE(said_after(0s, ExitCode::interrupted), "");
}

TEST_F(Playing, TakesNoMessageForItsOwn) {
  join(0);
  EXPECT_FALSE(playback_->handle({"ARM_PARTICIPANT", {}, "somebody"}));
  EXPECT_FALSE(playback_->knows("somebody"));
}

/// A session whose channel is SESSION, and whose run is over when `over` says so.
class SilentSession final : public Session {
 public:
  explicit SilentSession(bus::Transport& transport)
      : Session(loop::Role::logger, transport, {}, nullptr) {}
  void join(const loop::LawInfo& /*law*/, const Handler& /*other*/) override {}
  [[nodiscard]] std::int64_t run() const override { return 7; }
  void started(loop::Clock::time_point /*now*/) override {}
  void poll(loop::Clock::time_point now) override {
    ++polls;
    next_poll_ = now;
  }
  [[nodiscard]] loop::Clock::time_point next_poll() const override { return next_poll_; }
  bool handle(const bus::Datagram& datagram) override { return datagram.channel == "SESSION"; }
  void complete() override { over = true; }
  void handle_pending() override {}
  void progressed(std::int64_t /*tick*/, double /*error_norm*/) override {}
  [[nodiscard]] bool finished() const override { return over; }
  void leave() override {}
  [[nodiscard]] std::int64_t tick_of(loop::Role /*role*/) const override { return -1; }
  [[nodiscard]] std::string describe(loop::Role /*role*/) const override { return "process 42"; }
  [[nodiscard]] bool knows(std::string_view /*sender*/) const override { return false; }

  int polls = 0;
  bool over = false;

 private:
  void announce_fault(const diagnostics::Failure& /*failure*/) override {}

  loop::Clock::time_point next_poll_{};
};

class Looping : public testing::Test {
 protected:
  Looping() {
    session_.on("A", [this](const bus::Datagram&) { seen_.push_back("a"); });
    session_.on("B", [this](const bus::Datagram&) { seen_.push_back("b"); });
  }

  bus::InMemoryNetwork network_;
  std::unique_ptr<bus::Transport> own_ = network_.connect("own");
  std::unique_ptr<bus::Transport> other_ = network_.connect("other");
  SilentSession session_{*own_};
  std::vector<std::string> seen_;
};

TEST_F(Looping, GivesAMessageToTheHandlerOfItsChannel) {
  other_->publish("B", {});
  other_->publish("A", {});
  other_->publish("C", {});
  while (session_.receive({})) {
  }
  EXPECT_THAT(seen_, ElementsAre("b", "a"));
}

TEST_F(Looping, KeepsTheSessionsMessagesFromTheOtherHandlers) {
  session_.on("SESSION", [this](const bus::Datagram&) { seen_.push_back("other"); });
  other_->publish("SESSION", {});
  EXPECT_TRUE(session_.receive({}));
  EXPECT_THAT(seen_, ElementsAre());
  session_.on_session([this](const bus::Datagram&) { seen_.push_back("session"); });
  other_->publish("SESSION", {});
  EXPECT_TRUE(session_.receive({}));
  EXPECT_THAT(seen_, ElementsAre("session"));
}

TEST_F(Looping, RunsUntilTheSessionsRunIsOver) {
  other_->publish("A", {});
  int turns = 0;
  // The session is told when all ticks are there, and decides: this one agrees.
  session_.run_until_finished([&](Session::Time) { return turns == 2; },
                              [&](Session::Time now) {
                                ++turns;
                                return now;
                              });
  EXPECT_EQ(turns, 3);
  EXPECT_EQ(session_.polls, 3);
  EXPECT_THAT(seen_, ElementsAre("a"));
}

TEST_F(Looping, CountsWhatIsNotFresh) {
  for (const Verdict verdict : {Verdict::fresh, Verdict::repeated, Verdict::repeated,
                                Verdict::not_asked, Verdict::too_old}) {
    session_.count(verdict);
  }
  EXPECT_EQ(session_.statistics().duplicates, 2);
  std::map<std::string_view, std::int64_t> dropped;
  for (const auto& [reason, count] : session_.statistics().rejected.entries()) {
    if (count != 0) dropped[reason] = count;
  }
  EXPECT_THAT(dropped, ElementsAre(Pair("not_asked", 1), Pair("too_old", 1)));
}

TEST_F(Looping, FailsWhenTwoProcessesHaveOneRole) {
  const bus::Datagram second{"ARM_COMMAND", {}, "10.0.0.3:1"};
  const auto first = [] { return std::string_view("10.0.0.2:1"); };
  EXPECT_NO_THROW(session_.count(Verdict::repeated, loop::Role::controller, second, 5, first));
  try {
    session_.count(Verdict::conflicting, loop::Role::controller, second, 5, first);
    FAIL() << "nothing was thrown";
  } catch (const diagnostics::Failure& failure) {
    EXPECT_EQ(failure.code(), diagnostics::ExitCode::protocol_violated);
    EXPECT_THAT(failure.what(), AllOf(HasSubstr("two processes are the controller of run 7"),
                                      HasSubstr("10.0.0.2:1 and 10.0.0.3:1"), HasSubstr("tick 5"),
                                      HasSubstr("process 42")));
  }
}

}  // namespace
}  // namespace tachless::node
