#include "monitor/bus_monitor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bus/wire.h"

using namespace tachless;

namespace {

using monitor::BusMonitor;
using ::testing::Contains;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::SizeIs;

std::vector<std::byte> position(std::int64_t tick, std::int64_t run = 1) {
  robot::Vector q(2);
  q << 0.25, -0.5;
  bus::Codec<loop::PositionMeasurement> codec(loop::Layout{2, 0, 0});
  const auto bytes = codec.encode({1000 * tick, run, tick}, {q});
  return {bytes.begin(), bytes.end()};
}

/// A bus on which one sender speaks on one channel, once per millisecond.
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
  bus.monitor.end_stretch(0.1);
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
  EXPECT_EQ(bus.monitor.undecodable(), 2U);
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
  const auto table = bus.monitor.table(40, 12);
  EXPECT_THAT(table, SizeIs(12));
  EXPECT_THAT(table, Each(SizeIs(::testing::Le(40U + 2U))));  // "…" has three bytes
  EXPECT_THAT(table.back(), HasSubstr("lines more"));
}

TEST(BusMonitor, HasAllItsNumbersInEightyColumns) {
  Bus bus;
  bus.say("ARM_CONTROLLER_STATE", position(0));
  const auto narrow = bus.monitor.table(80), wide = bus.monitor.table(120);
  const std::string numbers =
      "channel               messages     per s  jitter us     kB/s   gaps undecodable";
  EXPECT_THAT(narrow, Contains(::testing::StartsWith(numbers)));
  EXPECT_THAT(narrow, Each(::testing::Not(HasSubstr("type"))));
  EXPECT_THAT(wide, Contains(::testing::StartsWith(numbers + "  type")));
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

}  // namespace
