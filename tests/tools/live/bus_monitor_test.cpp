#include "live/bus_monitor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <nlohmann/json.hpp>
#include <random>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "bus/authenticated.h"
#include "messages/truth/truth_wire.h"

using namespace tachless;

namespace {

using live::BusMonitor;
using ::testing::Contains;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::SizeIs;

std::vector<std::byte> position(std::int64_t tick, std::int64_t run = 1) {
  Vector q(2);
  q << 0.25, -0.5;
  messages::Codec<messages::PositionMeasurement> codec(messages::Layout{2, 0, 0});
  const auto bytes = codec.encode({1000 * tick, run, tick}, {q});
  return {bytes.begin(), bytes.end()};
}

/// A bus on which one sender publishes on one channel, once per millisecond.
class Bus {
 public:
  void say(const std::string& channel, const std::vector<std::byte>& payload,
           const std::string& sender = "10.0.0.1:1") {
    now_ns_ += 1'000'000;
    monitor.take({channel, payload, sender, sequence_++, now_ns_});
  }
  void lose_one() { ++sequence_; }
  nlohmann::json channel(const std::string& name) {
    const nlohmann::json json = monitor.to_json();
    for (const auto& entry : json["channels"]) {
      if (entry["channel"] == name) return entry;
    }
    return nullptr;
  }

  BusMonitor monitor;

 private:
  std::uint32_t sequence_ = 0xffff'fffe;  // wraps on the way
  std::int64_t now_ns_ = 1'000'000'000'000;
};

TEST(BusMonitor, TellsRateJitterBandwidthAndNewestValues) {
  Bus bus;
  for (int k = 0; k < 101; ++k) bus.say("ARM_POSITION", position(k));
  bus.monitor.end_interval(0.1);
  const auto entry = bus.channel("ARM_POSITION");
  EXPECT_EQ(entry["type"], "tachless.position_measurement_t");
  EXPECT_EQ(entry["messages"], 101);
  EXPECT_NEAR(entry["rate_hz"].get<double>(), 1000, 1e-6);  // rounding: the intervals are equal
  EXPECT_NEAR(entry["jitter_us"].get<double>(), 0, 1e-6);
  EXPECT_EQ(entry["longest_silence_us"], 1000);
  EXPECT_NEAR(entry["bandwidth_bytes_per_s"].get<double>(), 101 * 52 / 0.1, 1e-6);
  EXPECT_EQ(entry["tick_gaps"], 0);
  EXPECT_EQ(entry["newest"]["tick"], 100);
  EXPECT_EQ(entry["newest"]["position"], (std::vector<double>{0.25, -0.5}));
  EXPECT_THAT(bus.monitor.table(), Contains(HasSubstr("position [0.25 -0.5] rad")));
}

TEST(BusMonitor, CountsGapsByTickAndBySender) {
  Bus bus;
  for (const int k : {0, 1, 4, 5}) bus.say("ARM_POSITION", position(k));
  bus.lose_one();
  bus.say("ARM_POSITION", position(5));
  bus.say("ARM_POSITION", position(0, 2));  // another run: no gap, no step back
  const auto entry = bus.channel("ARM_POSITION");
  EXPECT_EQ(entry["tick_gaps"], 2);
  EXPECT_EQ(entry["tick_repeats"], 1);
  const nlohmann::json sender = bus.monitor.to_json()["senders"][0];
  EXPECT_EQ(sender["address"], "10.0.0.1:1");
  EXPECT_EQ(sender["messages"], 6);
  EXPECT_EQ(sender["missing"], 1);
  EXPECT_EQ(sender["restarts"], 0);
}

TEST(BusMonitor, CountsWhatCannotBeDecoded) {
  Bus bus;
  bus.say("OTHER", std::vector<std::byte>(20));
  bus.say("ARM_POSITION", position(0));
  auto cut = position(1);
  cut.pop_back();
  bus.say("ARM_POSITION", cut);
  bus.say("ARM_POSITION", std::vector<std::byte>(20));
  EXPECT_EQ(bus.monitor.to_json()["undecodable"], 2U);
  EXPECT_EQ(bus.channel("ARM_POSITION")["undecodable_because"]["wrong_size"], 1);
  EXPECT_EQ(bus.channel("ARM_POSITION")["newest"]["tick"], 0);
  EXPECT_EQ(bus.channel("OTHER")["undecodable"], 0);
  EXPECT_TRUE(bus.channel("OTHER")["type"].is_null());
  EXPECT_THAT(bus.monitor.table(), Contains(HasSubstr("not ours")));
}

TEST(BusMonitor, KeepsItsMemoryAndTheTerminalSafeFromStrangers) {
  Bus bus;
  for (std::size_t i = 0; i < 2 * BusMonitor::max_channels; ++i) {
    bus.say("\033[2J" + std::to_string(i), {}, std::to_string(i));
  }
  const auto json = bus.monitor.to_json();
  EXPECT_THAT(json["channels"], SizeIs(BusMonitor::max_channels));
  EXPECT_THAT(json["senders"], SizeIs(BusMonitor::max_senders));
  EXPECT_EQ(json["messages_on_further_channels"], BusMonitor::max_channels);
  EXPECT_THAT(bus.monitor.table(), Each(::testing::Not(HasSubstr("\033"))));
}

TEST(BusMonitor, FitsTheWindow) {
  Bus bus;
  for (int i = 0; i < 30; ++i) bus.say("CHANNEL_" + std::to_string(i), position(0));
  const auto table = bus.monitor.table(12);
  EXPECT_THAT(table, SizeIs(12));
  EXPECT_THAT(table.back(), HasSubstr("lines more"));
}

TEST(BusMonitor, HasAllItsNumbersInEightyColumns) {
  Bus bus;
  bus.say("ARM_CONTROLLER_STATE", position(0));
  const std::string numbers =
      "channel               messages     per s  jitter us     kB/s   gaps undecodable";
  EXPECT_LE(numbers.size(), 80U);  // a terminal cuts off what is beyond
  EXPECT_THAT(bus.monitor.table(), Contains(numbers + "  type"));
}

TEST(BusMonitor, SaysWhatTheTransportLost) {
  Bus bus;
  bus::BusStatistics statistics;
  statistics.overflowed = 5;
  statistics.malformed = 6;
  bus.monitor.set_statistics(statistics);
  EXPECT_EQ(bus.monitor.to_json()["lost_here"], 5);
  EXPECT_THAT(bus.monitor.table(), Contains(HasSubstr("5 lost here")));
  EXPECT_THAT(bus.monitor.table(), Contains(HasSubstr("6 datagrams that are not LCM")));
}

TEST(BusMonitor, CutsATextBetweenItsCharacters) {
  messages::Participant participant;
  participant.fault = std::string(39, 'x') + "\u00e9 and more";  // of two bytes
  messages::Codec<messages::Participant> codec(messages::Layout{});
  const auto bytes = codec.encode({0, 7, 3}, participant);
  Bus bus;
  bus.say("ARM_PARTICIPANT", {bytes.begin(), bytes.end()});
  EXPECT_THAT(bus.monitor.table(), Contains(HasSubstr(std::string(39, 'x') + "\u2026\"")));
}

using live::MessageField;

constexpr messages::Stamp stamp{1000, 7, 3};

template <class Value>
std::vector<std::byte> encoded(const messages::Layout& layout, const Value& value) {
  messages::Codec<Value> codec(layout);
  const auto bytes = codec.encode(stamp, value);
  return {bytes.begin(), bytes.end()};
}

Vector ramp(int n, double first) { return Vector::LinSpaced(n, first, first + n - 1); }

std::vector<double> numbers(const std::vector<MessageField>& fields, const std::string& name) {
  for (const MessageField& field : fields) {
    if (field.name == name) return field.value.get<std::vector<double>>();
  }
  throw std::out_of_range(name);
}

std::vector<MessageField> fields_of(std::span<const std::byte> message) {
  std::vector<MessageField> fields;
  live::glance(message, &fields);
  return fields;
}

TEST(Glance, ReadsEveryNumberOfJointsWithoutBeingTold) {
  for (int n = 1; n <= max_joints; ++n) {
    for (const int motors : {0, n}) {
      const auto message =
          encoded(messages::Layout{n, motors, 0},
                  messages::StateMeasurement{ramp(n, 0), ramp(n, 100), ramp(motors, 200),
                                             ramp(motors, 300)});
      const auto glance = live::glance(message);
      ASSERT_EQ(glance.type, "tachless.state_measurement_t");
      ASSERT_EQ(glance.rejection, messages::Rejection::none)
          << n << " joints, " << motors << " motors";
      EXPECT_EQ(glance.stamp.tick, stamp.tick);
      EXPECT_TRUE(glance.once_per_tick);
      const auto fields = fields_of(message);
      EXPECT_EQ(numbers(fields, "velocity").back(), 100 + n - 1);
      EXPECT_EQ(numbers(fields, "motor_velocity").size(), static_cast<std::size_t>(motors));
    }
  }
}

TEST(Glance, TellsSignalsFromJoints) {
  for (int num = 0; num <= messages::max_signals; ++num) {
    messages::LawSignals signals;
    signals.num = num;
    for (std::size_t i = 0; i < static_cast<std::size_t>(num); ++i) {
      signals.value[i] = ramp(3, 10.0 * static_cast<double>(i));
    }
    const auto message = encoded(messages::Layout{3, 0, num}, signals);
    ASSERT_EQ(live::glance(message).rejection, messages::Rejection::none);
    const auto fields = fields_of(message);
    EXPECT_EQ(fields.size(), static_cast<std::size_t>(num));
    if (num == 2) {
      EXPECT_EQ(numbers(fields, "value[1]"), (std::vector<double>{10, 11, 12}));
    }
  }
}

TEST(Glance, ReadsTheGroundTruth) {
  messages::truth::PlantTruth truth;
  truth.q = truth.v = truth.theta = truth.thetadot = ramp(2, 1);
  truth.tau = truth.disturbance = ramp(2, 5);
  truth.saturated[1] = true;
  const auto message = encoded(messages::Layout{2, 2, 0}, truth);
  ASSERT_EQ(live::glance(message).rejection, messages::Rejection::none);
  EXPECT_EQ(numbers(fields_of(message), "torque"), (std::vector<double>{5, 6}));
  EXPECT_EQ(numbers(fields_of(message), "saturated"), (std::vector<double>{0, 1}));
}

TEST(Glance, NoticesTheTagOfAKey) {
  std::vector<std::vector<std::byte>> messages = {
      encoded(messages::Layout{2, 0, 0}, messages::PositionMeasurement{ramp(2, 0)}),
      encoded(messages::Layout{}, messages::Participant{})};
  for (auto& message : messages) {
    EXPECT_FALSE(live::glance(message).tagged);
    message.resize(message.size() + bus::tag_size, std::byte{0xa5});
    const auto glance = live::glance(message);
    EXPECT_EQ(glance.rejection, messages::Rejection::none);
    EXPECT_TRUE(glance.tagged);
    EXPECT_EQ(glance.stamp.tick, stamp.tick);
    EXPECT_FALSE(fields_of(message).empty());
    message.pop_back();
    EXPECT_EQ(live::glance(message).rejection, messages::Rejection::wrong_size);
  }
}

TEST(Glance, DoesNotKnowOtherTypes) {
  EXPECT_TRUE(live::glance({}).type.empty());
  EXPECT_TRUE(live::glance(std::vector<std::byte>(100)).type.empty());
  EXPECT_TRUE(fields_of(std::vector<std::byte>(100)).empty());
}

TEST(Glance, RejectsCountsThatNoMessageHas) {
  auto message = encoded(messages::Layout{2, 0, 0}, messages::PositionMeasurement{ramp(2, 0)});
  for (const std::uint32_t count : {0U, 1U, 3U, 65U, 0x20000000U, 0x7fffffffU, 0xffffffffU}) {
    for (std::size_t i = 0; i < 4; ++i) {
      message[32 + i] = static_cast<std::byte>(count >> (24 - 8 * i));
    }
    const auto rejection = live::glance(message).rejection;
    EXPECT_NE(rejection, messages::Rejection::none) << count;
  }
}

TEST(Glance, SurvivesDamagedMessages) {
  messages::truth::PlantTruth truth;
  truth.q = truth.v = truth.tau = truth.disturbance = ramp(3, 1);
  const std::vector<std::vector<std::byte>> originals = {
      encoded(messages::Layout{3, 0, 0}, truth),
      encoded(messages::Layout{3, 0, 0}, messages::StateMeasurement{truth.q, truth.v, {}, {}}),
      encoded(messages::Layout{3, 0, 0}, messages::LawSignals{}),
      encoded(messages::Layout{}, messages::Participant{}),
      encoded(
          messages::Layout{},
          messages::RunInfo{{"own", "POSITION", "e:rad"}, 1, 1.0, "1", "ARM", "a: b", "<robot/>"})};
  std::mt19937 random(1);
  for (int i = 0; i < 20'000; ++i) {
    auto message = originals[random() % originals.size()];
    for (unsigned flips = random() % 4; flips > 0; --flips) {
      // Behind the fingerprint: another type is not ours to look at.
      message[8 + random() % (message.size() - 8)] ^= static_cast<std::byte>(1U << random() % 8);
    }
    if (random() % 2 == 0) message.resize(8 + random() % (message.size() - 8));
    const auto glance = live::glance(message);
    ASSERT_FALSE(glance.type.empty());
    const std::size_t num_fields = fields_of(message).size();
    if (glance.rejection != messages::Rejection::none) {
      ASSERT_EQ(num_fields, 0U);
    }
  }
}

}  // namespace
