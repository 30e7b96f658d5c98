// A run as a page of `watch --web` sees it: what its messages say and nothing that is not of it.

#include "live/live_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/json_text.h"
#include "bus/authenticated.h"
#include "tests/support/recorded_run.h"

namespace tachless::live {
namespace {

using logger::Recorded;
using logger::RecordedRun;
using nlohmann::json;

/// Plays messages to a LiveRun, a millisecond apart.
class Played {
 public:
  explicit Played(std::int64_t begin_ns = 1'000'000'000'000) : now_ns_(begin_ns) {}
  void say(const Recorded& message, std::size_t tag = 0) {
    now_ns_ += 1'000'000;
    const std::string data = message.data + std::string(tag, 'x');
    live.take({message.channel, std::as_bytes(std::span(data)), "10.0.0.1:1", 0, now_ns_});
  }
  void say_all(const RecordedRun& run, std::size_t tag = 0) {
    for (const Recorded& message : run.messages) say(message, tag);
  }
  LiveRun live;

 private:
  std::int64_t now_ns_;
};

/// Lowest and highest y of [t, y, t, y].
std::pair<double, double> extremes(const json& points) {
  return std::minmax(points.at(1).get<double>(), points.at(points.size() - 1).get<double>());
}

TEST(LiveRun, GivesTheLowestAndTheHighestValueOfEachSignalInAStretch) {
  const RecordedRun run = logger::short_rigid_run();
  for (const std::size_t tag : {std::size_t{0}, bus::tag_size}) {
    Played played;
    EXPECT_EQ(played.live.stretch(), "");
    played.say_all(run, tag);
    ASSERT_NE(played.live.run(), nullptr);
    EXPECT_EQ(played.live.run()->scenario.name, run.scenario.name);
    const json stretch = base::parse_json(played.live.stretch());
    EXPECT_EQ(stretch["run"], run.run);
    EXPECT_NEAR(stretch["t"].get<double>(), 39 * run.info.period_s, 1e-9);  // nine digits
    double low = INFINITY, high = -INFINITY, error = 0;
    for (const messages::TickRecord& tick : run.ticks) {
      low = std::min(low, tick.truth->q[1]);
      high = std::max(high, tick.truth->q[1]);
      error = std::max(error, std::abs(tick.truth->q[1] - tick.reference->q_ref[1]));
    }
    // Six digits are sent.
    const auto [shown_low, shown_high] = extremes(stretch["curves"]["q"][1]);
    EXPECT_NEAR(shown_low, low, 1e-5 * std::abs(low));
    EXPECT_NEAR(shown_high, high, 1e-5 * std::abs(high));
    EXPECT_NEAR(extremes(stretch["curves"]["|e|"][1]).second, error, 1e-5 * error);
    EXPECT_TRUE(stretch["curves"].contains("τ") && stretch["curves"].contains("nu"));
    EXPECT_EQ(played.live.stretch(), "") << "nothing has come since";
  }
}

TEST(LiveRun, HasMeasuredPositionsAndCommandsWhereThereIsNoTruth) {
  const RecordedRun run = logger::short_rigid_run();
  Played played;
  for (const Recorded& message : run.messages) {
    if (message.channel != "ARM_TRUTH") played.say(message);
  }
  const json curves = base::parse_json(played.live.stretch())["curves"];
  double high = -INFINITY;
  for (const messages::TickRecord& tick : run.ticks) high = std::max(high, tick.command->tau[0]);
  EXPECT_NEAR(extremes(curves["τ"][0]).second, high, 1e-5 * std::abs(high));
  EXPECT_TRUE(curves.contains("q"));
}

TEST(LiveRun, KeepsABoundedNumberOfEvents) {
  const RecordedRun run = logger::short_rigid_run();
  Played played;
  played.say_all(run);
  played.live.stretch();
  const Vector zero = Vector::Zero(2);
  auto references = messages::port<messages::ReferencePoint>("ARM", messages::layout(2, false));
  for (int i = 0; i < 1000; ++i) {
    const messages::ReferencePoint point{zero, zero, zero, zero, zero, "kp=" + std::to_string(i)};
    const auto bytes = references.codec.encode({0, run.run, 40 + i}, point);
    played.say({0, references.channel,
                std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size())});
  }
  const json events = base::parse_json(played.live.stretch())["events"];
  ASSERT_EQ(events.size(), 17U);
  EXPECT_EQ(events.back(), "and 984 more");
}

TEST(LiveRun, TellsTheBeginOfAContactAndItsForce) {
  const RecordedRun run = logger::short_rigid_run();
  Played played;
  played.say_all(run);
  played.live.stretch();
  auto contacts = messages::port<messages::truth::Contact>("ARM", messages::layout(2, false));
  const std::int64_t apart = std::llround(0.2 / run.info.period_s);  // ticks
  for (const std::int64_t tick : {0L, 1L, 2L, apart}) {
    const messages::truth::Contact contact{"MuJoCo 2.2.2", "tip, wall",
                                           5 + static_cast<double>(tick)};
    const auto bytes = contacts.codec.encode({0, run.run, tick}, contact);
    played.say({0, contacts.channel,
                std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size())});
  }
  const json stretch = base::parse_json(played.live.stretch());
  ASSERT_EQ(stretch["events"].size(), 2U) << stretch["events"];
  EXPECT_EQ(stretch["events"][0], "contact from 0 s (tip, wall)");
  EXPECT_EQ(extremes(stretch["curves"]["contact"][0]).first, 5);
}

TEST(LiveRun, CountsMissedCommandsAndSaysWhatHappened) {
  RecordedRun run = logger::short_rigid_run();
  Played played;
  played.say_all(run);
  played.say(fault_message(run, "the arm is gone"));
  played.say(fault_message(run, "again"));
  messages::Codec<messages::ReferencePoint> codec(messages::layout(2, false));
  messages::ReferencePoint reference = *run.ticks.back().reference;
  reference.gains = "kp=300,100";
  const auto bytes = codec.encode({0, run.run, run.ticks.back().tick}, reference);
  for (int i = 0; i < 2; ++i) {
    played.live.take({"ARM_REFERENCE", bytes, "10.0.0.1:1", 0, 2'000'000'000'000});
  }
  std::int64_t missed = 0;
  for (const messages::TickRecord& tick : run.ticks) {
    missed += tick.truth->fault == messages::truth::DriveFault::command_missed ? 1 : 0;
  }
  const json stretch = base::parse_json(played.live.stretch());
  EXPECT_EQ(stretch["missed"], missed);
  const std::string events = base::json_text(stretch["events"]);
  EXPECT_THAT(events, ::testing::HasSubstr("the arm"));
  EXPECT_THAT(events, ::testing::HasSubstr("kp=300,100"));
  const std::size_t at = events.find("gains from");
  EXPECT_EQ(events.find("gains from", at + 1), std::string::npos) << "each change once";
  EXPECT_THAT(events, ::testing::Not(::testing::HasSubstr("again"))) << "one fault of a role";
}

TEST(LiveRun, NumbersEveryStretchAlsoOneWithoutANewerTick) {
  const RecordedRun run = logger::short_rigid_run();
  Played played;
  played.say_all(run);
  const json first = base::parse_json(played.live.stretch());
  played.say(fault_message(run, "the arm is gone"));
  const json last = base::parse_json(played.live.stretch());
  EXPECT_EQ(last["t"], first["t"]);
  EXPECT_EQ(last["number"].get<std::int64_t>(), first["number"].get<std::int64_t>() + 1);
  EXPECT_THAT(base::json_text(last["events"]), ::testing::HasSubstr("the arm"));
  Played begun_again(2'000'000'000'000);  // the browser has the page of the one before
  begun_again.say_all(run);
  EXPECT_GT(base::parse_json(begun_again.live.stretch())["number"], last["number"]);
}

TEST(LiveRun, TakesNothingOfOtherRunsUntilTheirsBegins) {
  const RecordedRun first = logger::short_rigid_run(7), second = logger::short_rigid_run(8);
  Played played;
  played.say_all(first);
  (void)played.live.stretch();
  for (std::size_t i = 1; i < second.messages.size(); ++i) played.say(second.messages[i]);
  EXPECT_EQ(played.live.stretch(), "");
  for (int second_ms = 0; second_ms < 1000; ++second_ms) played.say({0, "OTHER", "?"});
  played.say_all(second);
  ASSERT_EQ(played.live.run()->run_id, 8);
  EXPECT_EQ(base::parse_json(played.live.stretch())["run"], 8);
}

TEST(LiveRun, StaysWhereItIsUnderGarbage) {
  const RecordedRun run = logger::short_rigid_run();
  Played played;
  played.say_all(run);
  (void)played.live.stretch();
  for (const Recorded& message : run.messages) {
    for (const std::size_t size : {0U, 7U, 8U, 31U, 40U}) {
      played.say({0, message.channel, message.data.substr(0, size)});
    }
    played.say({0, message.channel, message.data + "x"});
  }
  EXPECT_EQ(played.live.stretch(), "");
  EXPECT_EQ(played.live.run()->run_id, run.run);
}

}  // namespace
}  // namespace tachless::live
