#include "messages/wire.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <limits>
#include <string>
#include <string_view>
#include <tachless/both_positions_measurement_t.hpp>
#include <tachless/controller_state_t.hpp>
#include <tachless/gains_ack_t.hpp>
#include <tachless/gains_t.hpp>
#include <tachless/link_state_measurement_t.hpp>
#include <tachless/log_ack_t.hpp>
#include <tachless/motor_position_measurement_t.hpp>
#include <tachless/participant_t.hpp>
#include <tachless/position_measurement_t.hpp>
#include <tachless/reference_t.hpp>
#include <tachless/run_info_t.hpp>
#include <tachless/state_measurement_t.hpp>
#include <tachless/tick_t.hpp>
#include <tachless/torque_command_t.hpp>

#include "messages/codec.h"
#include "tests/core/messages/codec_checks.h"
#include "tests/support/counting_new.h"

namespace tachless::messages {
namespace {

using codec_checks::body;
using codec_checks::Bytes;
using codec_checks::overwrite_int32;
using codec_checks::sample;
using codec_checks::verdict;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

using codec_checks::Pair;
using TickType = Pair<messages::Tick, tachless::tick_t>;
using PositionType = Pair<messages::PositionMeasurement, tachless::position_measurement_t>;
using MotorPositionType =
    Pair<messages::MotorPositionMeasurement, tachless::motor_position_measurement_t>;
using BothPositionsType =
    Pair<messages::BothPositionsMeasurement, tachless::both_positions_measurement_t>;
using LinkStateType = Pair<messages::LinkStateMeasurement, tachless::link_state_measurement_t>;
using StateType = Pair<messages::StateMeasurement, tachless::state_measurement_t>;
using ReferenceType = Pair<messages::ReferencePoint, tachless::reference_t>;
using CommandType = Pair<messages::TorqueCommand, tachless::torque_command_t>;
using ControllerStateType = Pair<messages::LawSignals, tachless::controller_state_t>;
using ParticipantType = Pair<messages::Participant, tachless::participant_t>;
using RunInfoType = Pair<messages::RunInfo, tachless::run_info_t>;
using LogAckType = Pair<messages::LogAck, tachless::log_ack_t>;
using GainsType = Pair<messages::GainChange, tachless::gains_t>;
using GainAckType = Pair<messages::GainAck, tachless::gains_ack_t>;

template <class Type>
class EveryCodec : public testing::Test {};
using Types =
    testing::Types<TickType, PositionType, MotorPositionType, BothPositionsType, LinkStateType,
                   StateType, ReferenceType, CommandType, ControllerStateType, ParticipantType,
                   RunInfoType, LogAckType, GainsType, GainAckType>;
TYPED_TEST_SUITE(EveryCodec, Types);

TYPED_TEST(EveryCodec, AgreesWithGeneratedCodeByteForByte) {
  codec_checks::agrees_with_generated_code<TypeParam>();
}
TYPED_TEST(EveryCodec, SurvivesEveryCutAndEveryFlippedBit) {
  codec_checks::survives_damage<TypeParam>();
}
TYPED_TEST(EveryCodec, RejectsAnotherTypesFingerprint) {
  codec_checks::rejects_other_fingerprint<TypeParam>();
}
TYPED_TEST(EveryCodec, RejectsAnEmptyDatagram) {
  EXPECT_EQ(verdict<TypeParam>({2, 2, 2}, {}), Rejection::wrong_size);
}

TEST(Texts, HaveLinesOnlyWhereTheyAreFiles) {
  const auto is_clean = [](std::string_view text, bool lines) {
    auto field = messages::text("name", 99, &messages::RunInfo::version);
    field.lines = lines;
    return detail::is_clean(field, text);
  };
  for (const char c : {'\n', '\t', '\r'}) {
    EXPECT_TRUE(is_clean(std::string("a") + c + "b", true)) << int{c};
    EXPECT_FALSE(is_clean(std::string("a\x1b") + c, true)) << int{c};
    EXPECT_FALSE(is_clean(std::string("a") + c + "b", false)) << int{c};
  }
  EXPECT_FALSE(is_clean("\x7f", true));
  EXPECT_TRUE(is_clean("a b", false));
}

TEST(Texts, AreFilesInRunInfoAlone) {
  std::vector<std::string> files;
  messages::for_each_type(messages::Messages(),
                          [&]<class Value>(std::type_identity<Value> /*type*/) {
                            messages::for_each_field<Value>([&](const auto& field) {
                              if (field.lines)
                                files.push_back(fmt::format("{}.{}", Value::suffix, field.name));
                            });
                          });
  EXPECT_THAT(files, testing::ElementsAre("RUN_INFO.scenario", "RUN_INFO.robot_description"));
}

TEST(AnyMeasurementCodec, LeavesTheValueAsItIsWhenItRejects) {
  const messages::Layout layout{2, 2, 0};
  const Codec<messages::AnyMeasurement> codec("MOTOR_POSITION", layout);
  messages::Stamp stamp{1, 2, 3};
  messages::PositionMeasurement before;
  before.q = Vector::Constant(2, 5);
  messages::AnyMeasurement value = before;
  EXPECT_NE(codec.decode({}, stamp, value), Rejection::none);
  ASSERT_TRUE(std::holds_alternative<messages::PositionMeasurement>(value));
  EXPECT_EQ(std::get<messages::PositionMeasurement>(value).q, before.q);
  EXPECT_EQ(stamp.tick, 3);
}

TYPED_TEST(EveryCodec, RefusesToEncodeAnyNumberThatIsNotFinite) {
  using Value = typename TypeParam::Value;
  const messages::Layout layout{2, 2, 2};
  Codec<Value> codec(layout);
  messages::for_each_field<Value>([&](const auto& field) {
    const auto expect_refused = [&](const auto& damage) {
      Value value = codec_checks::random_value<Value>(layout);
      EXPECT_NO_THROW(codec.encode({}, value));
      damage(value.*field.member);
      EXPECT_FALSE(all_finite(value)) << field.name;
      EXPECT_THROW(codec.encode({}, value), std::domain_error) << field.name;
    };
    using Member = std::remove_reference_t<decltype(Value().*field.member)>;
    if constexpr (std::is_same_v<Member, Vector>) {
      expect_refused([](Member& vector) { vector[1] = -std::numeric_limits<double>::infinity(); });
    } else if constexpr (requires(Member member) { member[0].allFinite(); }) {
      for (const int row : {0, 1}) expect_refused([&](Member& rows) { rows[row][1] = nan; });
    } else if constexpr (std::is_same_v<Member, double>) {
      expect_refused([](double& number) { number = nan; });
    }
  });
}

// The bytes also agree if encoder and decoder exchange the same two fields. The test therefore
// checks that each member is the field of its name.
template <class Type>
auto both(const messages::Layout& layout) {
  return std::pair(codec_checks::random_value<typename Type::Value>(layout),
                   codec_checks::message_of<Type>(layout));
}

TEST(EveryField, IsItsOwnMember) {
  using codec_checks::reals_of;
  const messages::Layout layout{2, 2, 2};
  {
    const auto [value, message] = both<LinkStateType>(layout);
    EXPECT_EQ(reals_of(value.q), message.position);
    EXPECT_EQ(reals_of(value.v), message.velocity);
    EXPECT_EQ(reals_of(value.theta), message.motor_position);
  }
  {
    const auto [value, message] = both<StateType>(layout);
    EXPECT_EQ(reals_of(value.q), message.position);
    EXPECT_EQ(reals_of(value.v), message.velocity);
    EXPECT_EQ(reals_of(value.theta), message.motor_position);
    EXPECT_EQ(reals_of(value.thetadot), message.motor_velocity);
  }
  {
    const auto [value, message] = both<ReferenceType>(layout);
    EXPECT_EQ(reals_of(value.q_ref), message.position);
    EXPECT_EQ(reals_of(value.v_ref), message.velocity);
    EXPECT_EQ(reals_of(value.a_ref), message.acceleration);
    EXPECT_EQ(reals_of(value.jerk_ref), message.jerk);
    EXPECT_EQ(reals_of(value.snap_ref), message.snap);
  }
  {
    const auto [value, message] = both<ControllerStateType>(layout);
    for (int i = 0; i < 2; ++i) EXPECT_EQ(reals_of(value.value[i]), message.value[i]);
  }
  {
    const auto [value, message] = both<ParticipantType>(layout);
    EXPECT_EQ(value.instance, message.instance);
    EXPECT_EQ(value.scenario_digest, message.scenario_digest);
    EXPECT_EQ(value.truth_digest, message.truth_digest);
    EXPECT_EQ(value.counter, message.counter);
    EXPECT_EQ(value.heard_instance[2], message.heard_instance[2]);
    EXPECT_EQ(value.heard_counter[1], message.heard_counter[1]);
    EXPECT_EQ(value.roster[3], message.roster[3]);
    EXPECT_EQ(message.state, 4);
    EXPECT_EQ(message.fault_code, static_cast<std::int8_t>(130));
    EXPECT_EQ(message.role, "controller");
    for (const auto& [text, name] :
         {std::pair(message.host, "host"), std::pair(message.scenario, "scenario"),
          std::pair(message.law, "law"), std::pair(message.measurement, "measurement"),
          std::pair(message.fault, "fault")}) {
      EXPECT_EQ(text, name);
    }
  }
  {
    const auto [value, message] = both<RunInfoType>(layout);
    EXPECT_EQ(value.num_ticks, message.num_ticks);
    EXPECT_EQ(value.period_s, message.period_s);
    for (const auto& [text, name] :
         {std::pair(message.version, "version"), std::pair(message.robot, "robot"),
          std::pair(message.law, "law"), std::pair(message.measurement, "measurement"),
          std::pair(message.scenario, "scenario"),
          std::pair(message.robot_description, "robot_description")}) {
      EXPECT_EQ(text, name);
    }
  }
}

template <class Type>
class CodecOfFixedSize : public testing::Test {};
using FixedSizeTypes =
    testing::Types<TickType, PositionType, MotorPositionType, BothPositionsType, LinkStateType,
                   StateType, CommandType, ControllerStateType, LogAckType>;
TYPED_TEST_SUITE(CodecOfFixedSize, FixedSizeTypes);

TYPED_TEST(CodecOfFixedSize, DoesNotAllocateOnceConstructed) {
  for (const messages::Layout& layout : codec_checks::layouts()) {
    const Bytes bytes = sample<TypeParam>(layout);
    Codec<typename TypeParam::Value> codec(layout);
    messages::Stamp stamp;
    typename TypeParam::Value value;
    const std::size_t before = allocations;
    for (int i = 0; i < 3; ++i) {
      ASSERT_EQ(codec.decode(bytes, stamp, value), Rejection::none);
      ASSERT_EQ(codec.encode(stamp, value).size(), bytes.size());
      ASSERT_EQ(codec.decode(std::span(bytes).first(bytes.size() - 1), stamp, value),
                Rejection::wrong_size);
    }
    EXPECT_EQ(allocations, before) << layout.num_joints << " joints";
  }
}

template <class Type>
class CodecOfArrays : public testing::Test {};
using ArrayTypes = testing::Types<PositionType, MotorPositionType, BothPositionsType, LinkStateType,
                                  StateType, ReferenceType, CommandType, ControllerStateType>;
TYPED_TEST_SUITE(CodecOfArrays, ArrayTypes);

TYPED_TEST(CodecOfArrays, RejectsHostileCounts) {
  codec_checks::rejects_counts<TypeParam>(body, {2, 2, 2});
}
TYPED_TEST(CodecOfArrays, RejectsAMessageOfAnotherJointCount) {
  // The text makes a message longer than another one, so that the codec has to read the count.
  const auto rejection = messages::has_field<typename TypeParam::Value>("gains")
                             ? Rejection::wrong_count
                             : Rejection::wrong_size;
  EXPECT_EQ(verdict<TypeParam>({2, 2, 2}, sample<TypeParam>({3, 3, 2})), rejection);
  EXPECT_EQ(verdict<TypeParam>({3, 3, 2}, sample<TypeParam>({2, 2, 2})), Rejection::wrong_size);
}
TYPED_TEST(CodecOfArrays, RejectsNonFiniteReals) {
  const messages::Layout layout{3, 3, 2};
  constexpr std::size_t text =
      messages::has_field<typename TypeParam::Value>("gains") ? 4 + sizeof("gains") : 0;
  const std::size_t size = sample<TypeParam>(layout).size() - text;
  const std::size_t counts = (size - body) % 8 == 0 ? 8 : 4;
  codec_checks::rejects_non_finite<TypeParam>(body + counts, (size - body - counts) / 8, layout);
}
TYPED_TEST(CodecOfArrays, RefusesImpossibleLayouts) {
  using Value = typename TypeParam::Value;
  EXPECT_THROW(Codec<Value>({0, 0, 1}), std::logic_error);
  EXPECT_THROW(Codec<Value>({-1, 0, 1}), std::logic_error);
  EXPECT_THROW(Codec<Value>({65, 0, 1}), std::logic_error);
  EXPECT_THROW(Codec<Value>({2, 1, 1}), std::logic_error);
  EXPECT_THROW(Codec<Value>({2, 0, 9}), std::logic_error);
  EXPECT_THROW(Codec<Value>({2, 0, -1}), std::logic_error);
}
TYPED_TEST(CodecOfArrays, RefusesToEncodeSizesThatDisagreeWithTheLayout) {
  using Value = typename TypeParam::Value;
  messages::Stamp stamp;
  Value of_three;
  ASSERT_EQ(Codec<Value>({3, 3, 2}).decode(sample<TypeParam>({3, 3, 2}), stamp, of_three),
            Rejection::none);
  EXPECT_THROW(Codec<Value>({2, 2, 2}).encode(stamp, of_three), std::logic_error);
}
TYPED_TEST(CodecOfArrays, RefusesAValueWithoutEntries) {
  using Value = typename TypeParam::Value;
  EXPECT_THROW(Codec<Value>({2, 2, 2}).encode({}, Value{}), std::logic_error);
}

TEST(MeasurementCodec, TakesAndGivesTheTypeThatItsSuffixNamesAndNoOther) {
  const messages::Layout layout{2, 2, 0};
  const Vector q = Vector::Constant(2, 0.5);
  Codec<messages::AnyMeasurement> codec("MOTOR_POSITION", layout);
  Codec<messages::MotorPositionMeasurement> same(layout);
  EXPECT_EQ(codec.longest(), same.longest());
  const auto bytes = codec.encode({1, 2, 3}, messages::MotorPositionMeasurement{q});
  EXPECT_THAT(bytes, testing::ElementsAreArray(same.encode({1, 2, 3}, {q})));

  messages::Stamp stamp;
  messages::AnyMeasurement measured = messages::StateMeasurement{};
  EXPECT_EQ(codec.decode(bytes, stamp, measured), Rejection::none);
  EXPECT_EQ(stamp.tick, 3);
  EXPECT_EQ(std::get<messages::MotorPositionMeasurement>(measured).theta, q);
  Codec<messages::PositionMeasurement> other(layout);
  EXPECT_EQ(codec.decode(other.encode({1, 2, 3}, {q}), stamp, measured), Rejection::wrong_type);
  EXPECT_THROW((void)codec.encode({1, 2, 3}, messages::PositionMeasurement{q}),
               std::bad_variant_access);
}

TEST(StateCodec, RejectsHostileMotorCounts) {
  codec_checks::rejects_counts<StateType>(body + 4, {2, 2, 1});
  codec_checks::rejects_counts<StateType>(body + 4, {2, 0, 1});
}
TEST(StateCodec, LeavesNoMotorsOfAnEarlierMessageBehind) {
  messages::Stamp stamp;
  messages::StateMeasurement value;
  ASSERT_EQ(Codec<messages::StateMeasurement>({2, 2, 1}).decode(sample<StateType>({2, 2, 1}), stamp,
                                                                value),
            Rejection::none);
  ASSERT_EQ(Codec<messages::StateMeasurement>({2, 0, 1}).decode(sample<StateType>({2, 0, 1}), stamp,
                                                                value),
            Rejection::none);
  EXPECT_EQ(value.theta.size(), 0);
  EXPECT_EQ(value.thetadot.size(), 0);
}
TEST(ControllerStateCodec, RejectsHostileJointCounts) {
  codec_checks::rejects_counts<ControllerStateType>(body + 4, {2, 0, 2});
}
TEST(ControllerStateCodec, LeavesNoSignalOfAnEarlierMessageBehind) {
  messages::Stamp stamp;
  messages::LawSignals value;
  ASSERT_EQ(Codec<messages::LawSignals>({2, 0, 2}).decode(sample<ControllerStateType>({2, 0, 2}),
                                                          stamp, value),
            Rejection::none);
  ASSERT_EQ(Codec<messages::LawSignals>({2, 0, 1}).decode(sample<ControllerStateType>({2, 0, 1}),
                                                          stamp, value),
            Rejection::none);
  EXPECT_EQ(value.num, 1);
  EXPECT_EQ(value.value[1].size(), 0);
}
TEST(ControllerStateCodec, RefusesAnotherNumberOfSignals) {
  messages::Stamp stamp;
  messages::LawSignals value;
  ASSERT_EQ(Codec<messages::LawSignals>({2, 0, 2}).decode(sample<ControllerStateType>({2, 0, 2}),
                                                          stamp, value),
            Rejection::none);
  EXPECT_THROW(Codec<messages::LawSignals>({2, 0, 1}).encode(stamp, value), std::logic_error);
}
TEST(ControllerStateCodec, RefusesASignalOfAnotherSizeWhicheverItIs) {
  for (const std::size_t row : {0, 1}) {
    messages::LawSignals value;
    value.num = 2;
    value.value[0] = value.value[1] = Vector::Zero(2);
    Codec<messages::LawSignals> codec({2, 0, 2});
    EXPECT_NO_THROW(codec.encode({}, value));
    value.value[row] = Vector::Zero(3);
    EXPECT_THROW(codec.encode({}, value), std::logic_error) << row;
  }
}

TEST(AnnouncedLayout, IsThatOfTheCountsAndOfNoMessageThatEndsAmongThem) {
  const auto expect = [](const auto& bytes, const messages::Layout& layout, auto announced) {
    EXPECT_EQ(announced(bytes), layout);
    const std::span<const std::byte> whole(bytes);
    const std::size_t counts = 2 * sizeof(std::int32_t);
    EXPECT_TRUE(announced(whole.first(body + counts)));
    EXPECT_FALSE(announced(whole.first(body + counts - 1)));
    EXPECT_FALSE(announced(whole.first(body + counts / 2)));
    EXPECT_FALSE(announced(whole.first(body)));
  };
  expect(sample<StateType>({3, 3, 0}), messages::Layout{3, 3, 0},
         announced_layout<messages::StateMeasurement>);
  expect(sample<ControllerStateType>({3, 0, 2}), messages::Layout{3, 0, 2},
         announced_layout<messages::LawSignals>);
}

TEST(Names, OfRejectionsAndRolesAreWhatTheHeaderSays) {
  EXPECT_EQ(name(Rejection::none), "none");
  EXPECT_EQ(name(Rejection::wrong_size), "wrong_size");
  EXPECT_EQ(name(Rejection::wrong_type), "wrong_type");
  EXPECT_EQ(name(Rejection::wrong_count), "wrong_count");
  EXPECT_EQ(name(Rejection::non_finite), "non_finite");
  EXPECT_EQ(name(Rejection::bad_text), "bad_text");
  EXPECT_EQ(name(Rejection::bad_value), "bad_value");
  EXPECT_EQ(name(messages::Role::plant), "plant");
  EXPECT_EQ(name(messages::Role::reference), "reference");
  EXPECT_EQ(name(messages::Role::controller), "controller");
  EXPECT_EQ(name(messages::Role::logger), "logger");
}
TEST(Channels, AreUpperSnakeWithTheRobotsName) {
  EXPECT_EQ(messages::channel<messages::PositionMeasurement>("ARM"), "ARM_POSITION");
  EXPECT_EQ(messages::channel<messages::RunInfo>("ARM"), "ARM_RUN_INFO");
}

TEST(Fingerprint, IsReadFromTheFirstEightBytes) {
  const std::vector<std::byte> bytes = {std::byte{1}, std::byte{0}, std::byte{0}, std::byte{0},
                                        std::byte{0}, std::byte{0}, std::byte{0}, std::byte{2}};
  EXPECT_EQ(fingerprint_of(bytes), (std::int64_t{1} << 56) + 2);
  EXPECT_EQ(fingerprint_of(std::span(bytes).first(7)), std::nullopt);
}

}  // namespace
}  // namespace tachless::messages
