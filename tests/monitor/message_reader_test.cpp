#include "monitor/message_reader.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "bus/authenticated.h"
#include "bus/truth/truth_wire.h"

using namespace tachless;

namespace {

using monitor::MessageField;
using monitor::MessageReader;

constexpr loop::Stamp stamp{1000, 7, 3};

template <class Value>
std::vector<std::byte> encoded(const loop::Layout& layout, const Value& value) {
  bus::Codec<Value> codec(layout);
  const auto bytes = codec.encode(stamp, value);
  return {bytes.begin(), bytes.end()};
}

robot::Vector ramp(int n, double first) {
  return robot::Vector::LinSpaced(n, first, first + n - 1);
}

std::vector<double> numbers(const std::vector<MessageField>& fields, const std::string& name) {
  for (const MessageField& field : fields) {
    if (field.name == name) return std::get<std::vector<double>>(field.value);
  }
  throw std::out_of_range(name);
}

TEST(MessageReader, ReadsEveryNumberOfJointsWithoutBeingTold) {
  MessageReader reader;
  for (int n = 1; n <= robot::max_joints; ++n) {
    for (const int motors : {0, n}) {
      const auto message = encoded(
          loop::Layout{n, motors, 0},
          loop::StateMeasurement{ramp(n, 0), ramp(n, 100), ramp(motors, 200), ramp(motors, 300)});
      const auto glance = reader.glance(message);
      ASSERT_EQ(glance.type, "tachless.state_measurement_t");
      ASSERT_EQ(glance.rejection, bus::Rejection::none) << n << " joints, " << motors << " motors";
      EXPECT_EQ(glance.stamp.tick, stamp.tick);
      EXPECT_TRUE(glance.once_per_tick);
      const auto fields = reader.fields(message);
      EXPECT_EQ(numbers(fields, "velocity").back(), 100 + n - 1);
      EXPECT_EQ(numbers(fields, "motor_velocity").size(), static_cast<std::size_t>(motors));
    }
  }
}

TEST(MessageReader, TellsSignalsFromJoints) {
  MessageReader reader;
  for (int num = 0; num <= loop::max_signals; ++num) {
    loop::LawSignals signals;
    signals.num = num;
    for (std::size_t i = 0; i < static_cast<std::size_t>(num); ++i) {
      signals.value[i] = ramp(3, 10.0 * static_cast<double>(i));
    }
    const auto message = encoded(loop::Layout{3, 0, num}, signals);
    ASSERT_EQ(reader.glance(message).rejection, bus::Rejection::none);
    const auto fields = reader.fields(message);
    EXPECT_EQ(fields.size(), static_cast<std::size_t>(num));
    if (num == 2) {
      EXPECT_EQ(numbers(fields, "value[1]"), (std::vector<double>{10, 11, 12}));
    }
  }
}

TEST(MessageReader, ReadsTheGroundTruth) {
  MessageReader reader;
  loop::truth::PlantTruth truth;
  truth.q = truth.v = truth.theta = truth.thetadot = ramp(2, 1);
  truth.tau = truth.disturbance = ramp(2, 5);
  truth.saturated[1] = true;
  const auto message = encoded(loop::Layout{2, 2, 0}, truth);
  ASSERT_EQ(reader.glance(message).rejection, bus::Rejection::none);
  EXPECT_EQ(numbers(reader.fields(message), "torque"), (std::vector<double>{5, 6}));
  EXPECT_EQ(numbers(reader.fields(message), "saturated"), (std::vector<double>{0, 1}));
}

TEST(MessageReader, NoticesTheTagOfAKey) {
  MessageReader reader;
  std::vector<std::vector<std::byte>> messages = {
      encoded(loop::Layout{2, 0, 0}, loop::PositionMeasurement{ramp(2, 0)}),
      encoded(loop::Layout{}, loop::Participant{})};
  for (auto& message : messages) {
    EXPECT_FALSE(reader.glance(message).tagged);
    message.resize(message.size() + bus::tag_size, std::byte{0xa5});
    const auto glance = reader.glance(message);
    EXPECT_EQ(glance.rejection, bus::Rejection::none);
    EXPECT_TRUE(glance.tagged);
    EXPECT_EQ(glance.stamp.tick, stamp.tick);
    EXPECT_FALSE(reader.fields(message).empty());
    message.pop_back();
    EXPECT_EQ(reader.glance(message).rejection, bus::Rejection::wrong_size);
  }
}

TEST(MessageReader, DoesNotKnowOtherTypes) {
  MessageReader reader;
  EXPECT_TRUE(reader.glance({}).type.empty());
  EXPECT_TRUE(reader.glance(std::vector<std::byte>(100)).type.empty());
  EXPECT_THROW(reader.fields(std::vector<std::byte>(100)), std::logic_error);
}

TEST(MessageReader, RejectsCountsThatNoMessageHas) {
  MessageReader reader;
  auto message = encoded(loop::Layout{2, 0, 0}, loop::PositionMeasurement{ramp(2, 0)});
  for (const std::uint32_t count : {0U, 1U, 3U, 65U, 0x20000000U, 0x7fffffffU, 0xffffffffU}) {
    for (std::size_t i = 0; i < 4; ++i) {
      message[32 + i] = static_cast<std::byte>(count >> (24 - 8 * i));
    }
    const auto rejection = reader.glance(message).rejection;
    EXPECT_NE(rejection, bus::Rejection::none) << count;
  }
}

TEST(MessageReader, SurvivesDamagedMessages) {
  MessageReader reader;
  loop::truth::PlantTruth truth;
  truth.q = truth.v = truth.tau = truth.disturbance = ramp(3, 1);
  const std::vector<std::vector<std::byte>> originals = {
      encoded(loop::Layout{3, 0, 0}, truth),
      encoded(loop::Layout{3, 0, 0}, loop::StateMeasurement{truth.q, truth.v, {}, {}}),
      encoded(loop::Layout{3, 0, 0}, loop::LawSignals{}),
      encoded(loop::Layout{}, loop::Participant{}),
      encoded(loop::Layout{},
              loop::RunInfo{1, 1.0, "1", "ARM", "own", "POSITION", "e:rad", "a: b", "<robot/>"})};
  std::mt19937 random(1);
  for (int i = 0; i < 20'000; ++i) {
    auto message = originals[random() % originals.size()];
    for (unsigned flips = random() % 4; flips > 0; --flips) {
      // Behind the fingerprint: another type is not ours to look at.
      message[8 + random() % (message.size() - 8)] ^= static_cast<std::byte>(1U << random() % 8);
    }
    if (random() % 2 == 0) message.resize(8 + random() % (message.size() - 8));
    const auto glance = reader.glance(message);
    ASSERT_FALSE(glance.type.empty());
    if (glance.rejection == bus::Rejection::none) reader.fields(message);
  }
}

}  // namespace
