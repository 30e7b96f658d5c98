#include "node/loop.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "diagnostics/failure.h"
#include "tests/support/in_memory.h"

namespace tachless::node {
namespace {

using protocol::lockstep::Verdict;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;

/// A session whose channel is SESSION, and whose run is over when `over` says so.
class SilentSession final : public Session {
 public:
  SilentSession() : Session(loop::Role::logger, nullptr) {}
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
    loop_.on("A", [this](const bus::Datagram&) { seen_.push_back("a"); });
    loop_.on("B", [this](const bus::Datagram&) { seen_.push_back("b"); });
  }

  bus::InMemoryNetwork network_;
  std::unique_ptr<bus::Transport> own_ = network_.connect("own");
  std::unique_ptr<bus::Transport> other_ = network_.connect("other");
  SilentSession session_;
  Loop loop_{*own_, session_};
  std::vector<std::string> seen_;
};

TEST_F(Looping, GivesAMessageToTheHandlerOfItsChannel) {
  other_->publish("B", {});
  other_->publish("A", {});
  other_->publish("C", {});
  while (loop_.receive({})) {
  }
  EXPECT_THAT(seen_, ElementsAre("b", "a"));
}

TEST_F(Looping, KeepsTheSessionsMessagesFromTheOtherHandlers) {
  loop_.on("SESSION", [this](const bus::Datagram&) { seen_.push_back("other"); });
  loop_.handle({"SESSION", {}, "other"});
  EXPECT_THAT(seen_, ElementsAre());
  loop_.on_session([this](const bus::Datagram&) { seen_.push_back("session"); });
  loop_.handle({"SESSION", {}, "other"});
  EXPECT_THAT(seen_, ElementsAre("session"));
}

TEST_F(Looping, RunsUntilTheSessionsRunIsOver) {
  other_->publish("A", {});
  int turns = 0;
  // The session is told when all ticks are there, and decides: this one agrees.
  loop_.run_until_finished([&](Loop::Time) { return turns == 2; },
                           [&](Loop::Time now) {
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
    loop_.count(verdict);
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
  EXPECT_NO_THROW(loop_.count(Verdict::repeated, loop::Role::controller, second, 5, first));
  try {
    loop_.count(Verdict::conflicting, loop::Role::controller, second, 5, first);
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
