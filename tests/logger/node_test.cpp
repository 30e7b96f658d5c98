// The logger process against others that send what a test wants.
#include "logger/node.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bus/key.h"
#include "logger/log_file.h"
#include "messages/truth/truth_wire.h"
#include "tests/support/other_nodes.h"
#include "tests/support/temporary_directory.h"

namespace tachless::logger {
namespace {

using base::ExitCode;
using messages::Role;
using messages::truth::PlantTruth;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr std::int64_t run = support::OtherNodes::run;
constexpr std::int64_t num_ticks = 30;

/// The logger process of practical_rigid over 30 ticks, its ports and its log.
class ALogger : public ::testing::Test {
 protected:
  explicit ALogger(std::vector<std::string> overrides = {}) {
    scenario_ = support::thirty_ticks(std::move(overrides));
    others_.emplace(scenario_, Role::logger);
  }

  static Vector numbers(std::int64_t k) { return Vector::Constant(2, static_cast<double>(k)); }
  template <class Value>
  void send(messages::Port<Value>& port, std::int64_t k, const Value& value,
            const std::string& from) {
    others_->send(port, {k * 1000, run, k}, value, from);
  }
  void send_tick(std::int64_t k) { send(tick_, k, {}, "plant's address"); }
  void send_position(std::int64_t k, const std::string& from = "plant's address",
                     double offset = 0) {
    send(position_, k, {numbers(k).array() + offset}, from);
  }
  void send_reference(std::int64_t k) {
    send(reference_, k, {numbers(k), numbers(k), numbers(k), numbers(k), numbers(k)},
         "reference's address");
  }
  void send_command(std::int64_t k) { send(command_, k, {numbers(k)}, "controller's address"); }
  void send_state(std::int64_t k) { send(state_, k, {}, "controller's address"); }
  void send_truth(std::int64_t k) {
    PlantTruth truth;
    truth.q = truth.v = truth.tau = truth.disturbance = numbers(k);
    send(truth_, k, truth, "plant's address");
    const auto bytes = truth_.codec.encode({k * 1000, run, k}, truth);
    truths_[k].assign(bytes.begin(), bytes.end());
  }
  /// Sends the six messages of a tick.
  void send_all(std::int64_t k) {
    send_reference(k);
    send_tick(k);
    send_position(k);
    send_command(k);
    send_state(k);
    send_truth(k);
  }
  support::NodeOutcome finish() {
    others_->then([this] {
      bus::Digest digest;
      for (const auto& [k, bytes] : truths_) digest.add(bytes);
      others_->member(Role::plant).set_truth_digest(digest.value());
    });
    return support::run_among(*others_, scenario_, Role::logger, [this](session::Session& session) {
      run_node(scenario_, session, log_);
    });
  }

  /// An event of the log; the tick is -1 where the message has none.
  struct Event {
    std::string channel;
    std::int64_t utime = 0, tick = -1;
    friend bool operator==(const Event&, const Event&) = default;
  };
  std::vector<Event> events() {
    std::vector<Event> all;
    LogReader reader(log_);
    while (const auto event = reader.next()) {
      const messages::Stamp stamp = messages::stamp_of(event->data);
      all.push_back({std::string(event->channel), event->utime, stamp.tick});
    }
    EXPECT_FALSE(reader.damage().any()) << reader.damage().text();
    return all;
  }
  /// Returns the ticks of a channel in the order of the log.
  std::vector<std::int64_t> ticks_of(const std::string& channel) {
    std::vector<std::int64_t> ticks;
    for (const Event& event : events()) {
      if (event.channel == channel) ticks.push_back(event.tick);
    }
    return ticks;
  }
  void expect_a_whole_log() {
    const auto all = events();
    ASSERT_EQ(all.size(), 1U + 6 * num_ticks);
    EXPECT_EQ(all[0].channel, "ARM_RUN_INFO");
    for (std::int64_t k = 0; k < num_ticks; ++k) {
      std::size_t at = 1 + 6 * static_cast<std::size_t>(k);
      for (const auto* suffix :
           {"TICK", "POSITION", "REFERENCE", "COMMAND", "CONTROLLER_STATE", "TRUTH"}) {
        EXPECT_EQ(all[at++], (Event{std::string("ARM_") + suffix, k * 1000, k}));
      }
    }
  }

  scenario::Scenario scenario_;
  TemporaryDirectory directory_;
  std::filesystem::path log_ = directory_ / "lcmlog";
  std::optional<support::OtherNodes> others_;
  messages::Layout layout_{.num_joints = 2, .num_motors = 0, .num_signals = 0};
  messages::Port<messages::Tick> tick_ = messages::port<messages::Tick>("ARM", layout_);
  messages::Port<messages::PositionMeasurement> position_ =
      messages::port<messages::PositionMeasurement>("ARM", layout_);
  messages::Port<messages::ReferencePoint> reference_ =
      messages::port<messages::ReferencePoint>("ARM", layout_);
  messages::Port<messages::TorqueCommand> command_ =
      messages::port<messages::TorqueCommand>("ARM", layout_);
  messages::Port<messages::LawSignals> state_ =
      messages::port<messages::LawSignals>("ARM", layout_);
  messages::Port<PlantTruth> truth_ = messages::port<PlantTruth>("ARM", layout_);
  messages::Port<messages::LogAck> acknowledgement_ = messages::port<messages::LogAck>("ARM", {});
  std::map<std::int64_t, std::vector<std::byte>> truths_;  ///< that the plant has published
};

class ARealtimeLogger : public ALogger {
 protected:
  ARealtimeLogger() : ALogger({"loop.mode=realtime"}) {}
};

TEST_F(ALogger, WritesRunInfoAndThenTheTicksInOrder) {
  for (std::int64_t k = 0; k < num_ticks; ++k) others_->then([=, this] { send_all(k); });
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  expect_a_whole_log();
  EXPECT_EQ(outcome.statistics.ticks, num_ticks);
  EXPECT_EQ(outcome.statistics.logger().log.ticks, num_ticks);
  EXPECT_EQ(outcome.statistics.logger().log.events, 1 + 6 * num_ticks);
  EXPECT_EQ(outcome.statistics.logger().log.path, log_.string());
}

TEST_F(ALogger, WritesTheSameInWhateverOrderTheMessagesArrive) {
  for (std::int64_t k = 0; k < num_ticks; k += 3) {
    for (const std::int64_t i : {k + 2, k, k + 1}) {
      others_->then([=, this] {
        send_truth(i);
        send_state(i);
        send_position(i);
        send_position(i);
      });
    }
    for (const std::int64_t i : {k, k + 2, k + 1}) {
      others_->then([=, this] {
        send_command(i);
        send_tick(i);
        send_reference(i);
      });
    }
  }
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  expect_a_whole_log();
  EXPECT_EQ(outcome.statistics.duplicates, num_ticks);
}

TEST_F(ALogger, AsksForTheMessagesThatItMisses) {
  for (std::int64_t k = 0; k < 5; ++k) others_->then([=, this] { send_all(k); });
  others_->then([this] {
    send_reference(5);
    send_tick(5);
    send_position(5);
    send_command(5);
    send_state(5);
  });
  for (std::int64_t k = 6; k < 25; ++k) others_->then([=, this] { send_all(k); });
  others_->then([this] { send_tick(24); });  // the plant asks again, without an acknowledgement
  others_->then([this] {
    const auto asked = others_->values(acknowledgement_);
    ASSERT_FALSE(asked.empty());
    EXPECT_EQ(asked.back().first.tick, 4);
    EXPECT_EQ(asked.back().second.missing & 0b111, 0b001U);  // 5, and neither 6 nor 7
    send_truth(5);
  });
  for (std::int64_t k = 25; k < num_ticks; ++k) others_->then([=, this] { send_all(k); });
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  expect_a_whole_log();
  const auto asked = others_->values(acknowledgement_);
  EXPECT_EQ(asked.back().first.tick, num_ticks - 1);
  EXPECT_EQ(asked.back().second.missing, 0U);
}

TEST_F(ALogger, EndsWhenTwoPlantsMeasureAndItsLogSaysWhy) {
  for (std::int64_t k = 0; k < 5; ++k) others_->then([=, this] { send_all(k); });
  others_->then([this] { send_position(4, "another address", 0.5); });
  const auto outcome = finish();
  EXPECT_EQ(outcome.code, ExitCode::protocol_violated);
  EXPECT_THAT(outcome.fault, HasSubstr("another address"));
  const auto all = events();
  ASSERT_EQ(all.size(), 1U + 6 * 5 + 1);
  EXPECT_EQ(all.back().channel, "ARM_PARTICIPANT");  // the announcement of the fault
}

TEST_F(ALogger, EndsWhenATruthIsNotThePlantsOwn) {
  for (std::int64_t k = 0; k < num_ticks; ++k) others_->then([=, this] { send_all(k); });
  others_->then([this] { truths_[12][40] = std::byte{1}; });
  const auto outcome = finish();
  EXPECT_EQ(outcome.code, ExitCode::protocol_violated);
  EXPECT_THAT(outcome.fault,
              HasSubstr("the messages recorded on ARM_TRUTH are not those that the plant"));
}

TEST_F(ALogger, RecordsNothingOfAnotherRun) {
  others_->then([this] { others_->send(tick_, {0, run + 1, 0}, {}); });
  for (std::int64_t k = 0; k < num_ticks; ++k) others_->then([=, this] { send_all(k); });
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  expect_a_whole_log();
  EXPECT_EQ(outcome.statistics.rejected.total(), 1);
}

TEST_F(ARealtimeLogger, RecordsEachMessageOnceInOrderOfArrival) {
  others_->then([this] {
    send_reference(0);
    send_tick(0);
    send_tick(0);
    send_truth(0);
    send_tick(2);
    send_tick(1);
    send_tick(29);
    send_position(29);
    send_reference(29);
    send_command(29);
    send_state(29);
    send_truth(29);
  });
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(events()[0].channel, "ARM_RUN_INFO");
  EXPECT_THAT(ticks_of("ARM_TICK"), ElementsAre(0, 2, 1, 29));
  EXPECT_THAT(ticks_of("ARM_TRUTH"), ElementsAre(0, 29));
  EXPECT_THAT(ticks_of("ARM_POSITION"), ElementsAre(29));
  EXPECT_EQ(outcome.statistics.duplicates, 1);
  EXPECT_EQ(outcome.statistics.logger().log.ticks, 1);
  EXPECT_EQ(outcome.statistics.logger().log.gaps, num_ticks - 1);
  EXPECT_TRUE(others_->published[acknowledgement_.channel].empty());
}

TEST_F(ARealtimeLogger, CountsTheTicksAfterTheLastMessage) {
  others_->then([this] {
    send_all(0);
    send_all(5);
  });
  const auto outcome = finish();
  ASSERT_EQ(outcome.fault, "");
  EXPECT_EQ(outcome.statistics.logger().log.ticks, 2);
  EXPECT_EQ(outcome.statistics.logger().log.gaps, num_ticks - 2);
}

TEST_F(ARealtimeLogger, RecordsAlsoTheMessageThatContradicts) {
  others_->then([this] {
    send_all(0);
    send_position(0, "another address", 0.5);
  });
  const auto outcome = finish();
  EXPECT_EQ(outcome.code, ExitCode::protocol_violated);
  EXPECT_THAT(ticks_of("ARM_POSITION"), ElementsAre(0, 0));
  EXPECT_EQ(events().back().channel, "ARM_PARTICIPANT");
}

}  // namespace
}  // namespace tachless::logger
