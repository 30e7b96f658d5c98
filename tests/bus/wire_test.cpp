#include "bus/wire.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <limits>
#include <string>
#include <tachless/controller_state_t.hpp>
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

#include "tests/bus/codec_checks.h"
#include "tests/support/counting_new.h"

namespace tachless::bus {
namespace {

using codec_checks::Bytes;
using codec_checks::overwrite_int32;
using codec_checks::Random;
using codec_checks::sample;
using codec_checks::verdict;

constexpr std::size_t body = 32;  // fingerprint, utime, run, tick
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

struct TickType {
  using Value = loop::Tick;
  using Message = tachless::tick_t;
  static Message message(const loop::Layout&, Random&) {
    Message m{};
    m.last = 1;
    return m;
  }
};
struct PositionType {
  using Value = loop::PositionMeasurement;
  using Message = tachless::position_measurement_t;
  static Message message(const loop::Layout& layout, Random& random) {
    Message m{};
    m.num_joints = layout.num_joints;
    m.position = random.reals(layout.num_joints);
    return m;
  }
};
struct MotorPositionType {
  using Value = loop::MotorPositionMeasurement;
  using Message = tachless::motor_position_measurement_t;
  static Message message(const loop::Layout& layout, Random& random) {
    Message m{};
    m.num_joints = layout.num_joints;
    m.motor_position = random.reals(layout.num_joints);
    return m;
  }
};
struct LinkStateType {
  using Value = loop::LinkStateMeasurement;
  using Message = tachless::link_state_measurement_t;
  static Message message(const loop::Layout& layout, Random& random) {
    Message m{};
    m.num_joints = layout.num_joints;
    m.position = random.reals(layout.num_joints);
    m.velocity = random.reals(layout.num_joints);
    m.motor_position = random.reals(layout.num_joints);
    return m;
  }
};
struct StateType {
  using Value = loop::StateMeasurement;
  using Message = tachless::state_measurement_t;
  static Message message(const loop::Layout& layout, Random& random) {
    Message m{};
    m.num_joints = layout.num_joints;
    m.num_motors = layout.num_motors;
    m.position = random.reals(layout.num_joints);
    m.velocity = random.reals(layout.num_joints);
    m.motor_position = random.reals(layout.num_motors);
    m.motor_velocity = random.reals(layout.num_motors);
    return m;
  }
};
struct ReferenceType {
  using Value = loop::ReferencePoint;
  using Message = tachless::reference_t;
  static Message message(const loop::Layout& layout, Random& random) {
    Message m{};
    m.num_joints = layout.num_joints;
    m.position = random.reals(layout.num_joints);
    m.velocity = random.reals(layout.num_joints);
    m.acceleration = random.reals(layout.num_joints);
    m.jerk = random.reals(layout.num_joints);
    m.snap = random.reals(layout.num_joints);
    return m;
  }
};
struct CommandType {
  using Value = loop::TorqueCommand;
  using Message = tachless::torque_command_t;
  static Message message(const loop::Layout& layout, Random& random) {
    Message m{};
    m.num_joints = layout.num_joints;
    m.torque = random.reals(layout.num_joints);
    return m;
  }
};
struct ControllerStateType {
  using Value = loop::LawSignals;
  using Message = tachless::controller_state_t;
  static Message message(const loop::Layout& layout, Random& random) {
    Message m{};
    m.num_signals = layout.num_signals;
    m.num_joints = layout.num_joints;
    for (int i = 0; i < layout.num_signals; ++i) {
      m.value.push_back(random.reals(layout.num_joints));
    }
    return m;
  }
};
struct ParticipantType {
  using Value = loop::Participant;
  using Message = tachless::participant_t;
  static Message message(const loop::Layout&, Random& random) {
    Message m{};
    m.instance = -5;
    m.scenario_digest = 0x7edcba9876543210;
    m.pid = 4711;
    m.state = 4;
    m.fault_code = static_cast<std::int8_t>(130);
    m.error_norm = std::abs(random.real());
    m.role = "controller";
    m.host = "workbench";
    m.scenario = "paper_rigid";
    m.law = "loria_ortega_rigid";
    m.measurement = "POSITION";
    m.signals = "error:rad";
    m.fault = "";
    m.counter = 812;
    m.truth_digest = -0x123456789abcdef;
    for (int role = 0; role < 4; ++role) {
      m.heard_instance[role] = 0x7edcba9876543210 - role;
      m.heard_counter[role] = -role;
      m.roster[role] = 1LL << (60 - role);
    }
    return m;
  }
};
struct RunInfoType {
  using Value = loop::RunInfo;
  using Message = tachless::run_info_t;
  static Message message(const loop::Layout&, Random&) {
    Message m{};
    m.num_ticks = 40000;
    m.period_s = 5.0e-5;
    m.version = "0.1.0";
    m.robot = "ARM";
    m.law = "loria_ortega_rigid";
    m.measurement = "POSITION";
    m.signals = "error:rad,nu:rad/s";
    m.scenario = "name: paper_rigid\n";
    m.robot_description = "<robot name=\"two_link\"/>";
    return m;
  }
};
struct LogAckType {
  using Value = loop::LogAck;
  using Message = tachless::log_ack_t;
  static Message message(const loop::Layout&, Random&) {
    Message m{};
    m.missing = -0x7fffffffffffffff;
    return m;
  }
};

template <class Type>
class EveryCodec : public testing::Test {};
using Types = testing::Types<TickType, PositionType, MotorPositionType, LinkStateType, StateType,
                             ReferenceType, CommandType, ControllerStateType, ParticipantType,
                             RunInfoType, LogAckType>;
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

// The bytes agree also if two fields are mixed up on the way in and on the way out again: each
// field must land in its own member.
template <class Type>
auto random_message(const loop::Layout& layout) {
  Random random;
  return Type::message(layout, random);
}

TEST(EveryField, LandsInItsOwnMember) {
  using codec_checks::decoded;
  using codec_checks::reals_of;
  const loop::Layout layout{2, 2, 2};
  {
    const auto message = random_message<LinkStateType>(layout);
    const auto value = decoded<loop::LinkStateMeasurement>(layout, message);
    EXPECT_EQ(reals_of(value.q), message.position);
    EXPECT_EQ(reals_of(value.v), message.velocity);
    EXPECT_EQ(reals_of(value.theta), message.motor_position);
  }
  {
    const auto message = random_message<StateType>(layout);
    const auto value = decoded<loop::StateMeasurement>(layout, message);
    EXPECT_EQ(reals_of(value.q), message.position);
    EXPECT_EQ(reals_of(value.v), message.velocity);
    EXPECT_EQ(reals_of(value.theta), message.motor_position);
    EXPECT_EQ(reals_of(value.thetadot), message.motor_velocity);
  }
  {
    const auto message = random_message<ReferenceType>(layout);
    const auto value = decoded<loop::ReferencePoint>(layout, message);
    EXPECT_EQ(reals_of(value.q_ref), message.position);
    EXPECT_EQ(reals_of(value.v_ref), message.velocity);
    EXPECT_EQ(reals_of(value.a_ref), message.acceleration);
    EXPECT_EQ(reals_of(value.jerk_ref), message.jerk);
    EXPECT_EQ(reals_of(value.snap_ref), message.snap);
  }
  {
    const auto message = random_message<ControllerStateType>(layout);
    const auto value = decoded<loop::LawSignals>(layout, message);
    ASSERT_EQ(value.num, 2);
    for (int i = 0; i < 2; ++i) EXPECT_EQ(reals_of(value.value[i]), message.value[i]);
  }
  {
    auto message = random_message<ParticipantType>(layout);
    message.fault = "drive 2 is hot";
    const auto value = decoded<loop::Participant>(layout, message);
    EXPECT_EQ(value.instance, message.instance);
    EXPECT_EQ(value.scenario_digest, message.scenario_digest);
    EXPECT_EQ(value.pid, message.pid);
    EXPECT_EQ(value.state, loop::ParticipantState::fault);
    EXPECT_EQ(value.fault_code, 130);
    EXPECT_EQ(value.error_norm, message.error_norm);
    EXPECT_EQ(value.role, loop::Role::controller);
    EXPECT_EQ(value.host, message.host);
    EXPECT_EQ(value.scenario, message.scenario);
    EXPECT_EQ(value.measurement, message.measurement);
    EXPECT_EQ(value.signals, message.signals);
    EXPECT_EQ(value.fault, message.fault);
  }
  {
    const auto message = random_message<RunInfoType>(layout);
    const auto value = decoded<loop::RunInfo>(layout, message);
    EXPECT_EQ(value.num_ticks, message.num_ticks);
    EXPECT_EQ(value.period_s, message.period_s);
    EXPECT_EQ(value.version, message.version);
    EXPECT_EQ(value.robot, message.robot);
    EXPECT_EQ(value.measurement, message.measurement);
    EXPECT_EQ(value.signals, message.signals);
    EXPECT_EQ(value.scenario, message.scenario);
    EXPECT_EQ(value.robot_description, message.robot_description);
  }
}

template <class Type>
class CodecOfFixedSize : public testing::Test {};
using FixedSizeTypes =
    testing::Types<TickType, PositionType, MotorPositionType, LinkStateType, StateType,
                   ReferenceType, CommandType, ControllerStateType, LogAckType>;
TYPED_TEST_SUITE(CodecOfFixedSize, FixedSizeTypes);

TYPED_TEST(CodecOfFixedSize, DoesNotAllocateOnceConstructed) {
  for (const loop::Layout& layout : codec_checks::layouts()) {
    const Bytes bytes = sample<TypeParam>(layout);
    Codec<typename TypeParam::Value> codec(layout);
    loop::Stamp stamp;
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
using ArrayTypes = testing::Types<PositionType, MotorPositionType, LinkStateType, StateType,
                                  ReferenceType, CommandType, ControllerStateType>;
TYPED_TEST_SUITE(CodecOfArrays, ArrayTypes);

TYPED_TEST(CodecOfArrays, RejectsHostileCounts) {
  codec_checks::rejects_counts<TypeParam>(body, {2, 2, 2});
}
TYPED_TEST(CodecOfArrays, RejectsAMessageOfAnotherJointCount) {
  EXPECT_EQ(verdict<TypeParam>({2, 2, 2}, sample<TypeParam>({3, 3, 2})), Rejection::wrong_size);
  EXPECT_EQ(verdict<TypeParam>({3, 3, 2}, sample<TypeParam>({2, 2, 2})), Rejection::wrong_size);
}
TYPED_TEST(CodecOfArrays, RejectsNonFiniteReals) {
  const loop::Layout layout{3, 3, 2};
  const Bytes bytes = sample<TypeParam>(layout);
  const std::size_t counts = (bytes.size() - body) % 8 == 0 ? 8 : 4;
  codec_checks::rejects_non_finite<TypeParam>(body + counts, (bytes.size() - body - counts) / 8,
                                              layout);
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
  loop::Stamp stamp;
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
  const loop::Layout layout{2, 2, 0};
  const robot::Vector q = robot::Vector::Constant(2, 0.5);
  Codec<loop::AnyMeasurement> codec("MOTOR_POSITION", layout);
  Codec<loop::MotorPositionMeasurement> same(layout);
  EXPECT_EQ(codec.longest(), same.longest());
  const auto bytes = codec.encode({1, 2, 3}, loop::MotorPositionMeasurement{q});
  EXPECT_THAT(bytes, testing::ElementsAreArray(same.encode({1, 2, 3}, {q})));

  loop::Stamp stamp;
  loop::AnyMeasurement measured = loop::StateMeasurement{};
  EXPECT_EQ(codec.decode(bytes, stamp, measured), Rejection::none);
  EXPECT_EQ(stamp.tick, 3);
  EXPECT_EQ(std::get<loop::MotorPositionMeasurement>(measured).theta, q);
  Codec<loop::PositionMeasurement> other(layout);
  EXPECT_EQ(codec.decode(other.encode({1, 2, 3}, {q}), stamp, measured), Rejection::wrong_type);
  EXPECT_THROW((void)codec.encode({1, 2, 3}, loop::PositionMeasurement{q}),
               std::bad_variant_access);
}

TEST(StateCodec, RejectsHostileMotorCounts) {
  codec_checks::rejects_counts<StateType>(body + 4, {2, 2, 1});
  codec_checks::rejects_counts<StateType>(body + 4, {2, 0, 1});
}
TEST(StateCodec, LeavesNoMotorsOfAnEarlierMessageBehind) {
  loop::Stamp stamp;
  loop::StateMeasurement value;
  ASSERT_EQ(
      Codec<loop::StateMeasurement>({2, 2, 1}).decode(sample<StateType>({2, 2, 1}), stamp, value),
      Rejection::none);
  ASSERT_EQ(
      Codec<loop::StateMeasurement>({2, 0, 1}).decode(sample<StateType>({2, 0, 1}), stamp, value),
      Rejection::none);
  EXPECT_EQ(value.theta.size(), 0);
  EXPECT_EQ(value.thetadot.size(), 0);
}
TEST(ControllerStateCodec, RejectsHostileJointCounts) {
  codec_checks::rejects_counts<ControllerStateType>(body + 4, {2, 0, 2});
}
TEST(ControllerStateCodec, LeavesNoSignalOfAnEarlierMessageBehind) {
  loop::Stamp stamp;
  loop::LawSignals value;
  ASSERT_EQ(Codec<loop::LawSignals>({2, 0, 2}).decode(sample<ControllerStateType>({2, 0, 2}), stamp,
                                                      value),
            Rejection::none);
  ASSERT_EQ(Codec<loop::LawSignals>({2, 0, 1}).decode(sample<ControllerStateType>({2, 0, 1}), stamp,
                                                      value),
            Rejection::none);
  EXPECT_EQ(value.num, 1);
  EXPECT_EQ(value.value[1].size(), 0);
}
TEST(ControllerStateCodec, RefusesAnotherNumberOfSignals) {
  loop::Stamp stamp;
  loop::LawSignals value;
  ASSERT_EQ(Codec<loop::LawSignals>({2, 0, 2}).decode(sample<ControllerStateType>({2, 0, 2}), stamp,
                                                      value),
            Rejection::none);
  EXPECT_THROW(Codec<loop::LawSignals>({2, 0, 1}).encode(stamp, value), std::logic_error);
}
TEST(ControllerStateCodec, RefusesASignalOfAnotherSizeWhicheverItIs) {
  for (const std::size_t row : {0, 1}) {
    loop::LawSignals value;
    value.num = 2;
    value.value[0] = value.value[1] = robot::Vector::Zero(2);
    Codec<loop::LawSignals> codec({2, 0, 2});
    EXPECT_NO_THROW(codec.encode({}, value));
    value.value[row] = robot::Vector::Zero(3);
    EXPECT_THROW(codec.encode({}, value), std::logic_error) << row;
  }
}

TEST(AnnouncedLayout, IsThatOfTheCountsAndOfNoMessageThatEndsAmongThem) {
  const auto expect = [](const auto& bytes, const loop::Layout& layout, auto announced) {
    EXPECT_EQ(announced(bytes), layout);
    const std::span<const std::byte> whole(bytes);
    const std::size_t counts = 2 * sizeof(std::int32_t);
    EXPECT_TRUE(announced(whole.first(body + counts)));
    EXPECT_FALSE(announced(whole.first(body + counts - 1)));
    EXPECT_FALSE(announced(whole.first(body + counts / 2)));
    EXPECT_FALSE(announced(whole.first(body)));
  };
  expect(sample<StateType>({3, 3, 0}), loop::Layout{3, 3, 0},
         announced_layout<loop::StateMeasurement>);
  expect(sample<ControllerStateType>({3, 0, 2}), loop::Layout{3, 0, 2},
         announced_layout<loop::LawSignals>);
}

TEST(CommandCodec, RefusesToEncodeWhatIsNotFinite) {
  Codec<loop::TorqueCommand> codec({2, 0, 1});
  loop::TorqueCommand command{robot::Vector::Constant(2, 1.0)};
  EXPECT_TRUE(all_finite(command));
  EXPECT_NO_THROW(codec.encode({}, command));
  command.tau[1] = nan;
  EXPECT_FALSE(all_finite(command));
  EXPECT_THROW(codec.encode({}, command), std::domain_error);
  command.tau[1] = std::numeric_limits<double>::infinity();
  EXPECT_THROW(codec.encode({}, command), std::domain_error);
}
TEST(AllFinite, LooksAtEveryMemberOfEveryValue) {
  const robot::Vector good = robot::Vector::Zero(2);
  const robot::Vector bad = robot::Vector::Constant(2, nan);
  EXPECT_FALSE(all_finite(loop::PositionMeasurement{bad}));
  EXPECT_FALSE(all_finite(loop::MotorPositionMeasurement{bad}));
  EXPECT_FALSE(all_finite(loop::LinkStateMeasurement{bad, good, good}));
  EXPECT_FALSE(all_finite(loop::LinkStateMeasurement{good, bad, good}));
  EXPECT_FALSE(all_finite(loop::LinkStateMeasurement{good, good, bad}));
  EXPECT_FALSE(all_finite(loop::StateMeasurement{bad, good, good, good}));
  EXPECT_FALSE(all_finite(loop::StateMeasurement{good, bad, good, good}));
  EXPECT_FALSE(all_finite(loop::StateMeasurement{good, good, bad, good}));
  EXPECT_FALSE(all_finite(loop::StateMeasurement{good, good, good, bad}));
  EXPECT_FALSE(all_finite(loop::ReferencePoint{bad, good, good, good, good}));
  EXPECT_FALSE(all_finite(loop::ReferencePoint{good, bad, good, good, good}));
  EXPECT_FALSE(all_finite(loop::ReferencePoint{good, good, bad, good, good}));
  EXPECT_FALSE(all_finite(loop::ReferencePoint{good, good, good, bad, good}));
  EXPECT_FALSE(all_finite(loop::ReferencePoint{good, good, good, good, bad}));
  EXPECT_FALSE(all_finite(loop::LawSignals{1, {bad}}));
  EXPECT_FALSE(all_finite(loop::LawSignals{2, {good, bad}}));
  loop::Participant participant;
  participant.error_norm = nan;
  EXPECT_FALSE(all_finite(participant));
  loop::RunInfo info;
  info.period_s = nan;
  EXPECT_FALSE(all_finite(info));
}

// Offsets inside participant_t.
constexpr std::size_t participant_role = body;  // length of the text; it is "controller"
constexpr std::size_t participant_state = participant_role + 4 + 11;
constexpr std::size_t participant_error_norm = participant_state + 1;

/// A message with these bytes at `at` in place of its own, and what becomes of it.
struct Altered {
  const char* what;
  Rejection (*verdict)(const loop::Layout&, std::span<const std::byte>);
  Bytes message;
  std::size_t at;
  std::vector<int> bytes;
  Rejection expected = Rejection::bad_value;
};

TEST(Codecs, RejectSingleFieldsOutsideTheirRange) {
  constexpr auto tick = verdict<TickType>;
  constexpr auto participant = verdict<ParticipantType>;
  constexpr auto run_info = verdict<RunInfoType>;
  const Bytes a_tick = sample<TickType>({}), announced = sample<ParticipantType>({}),
              a_run_info = sample<RunInfoType>({});
  const auto text = Rejection::bad_text;
  const std::size_t last = a_tick.size() - 1, role = participant_role, version = body + 16;
  const std::vector<int> zeros(8, 0);
  const std::vector<Altered> all = {
      {"flag 0", tick, a_tick, last, {0}, Rejection::none},
      {"flag 1", tick, a_tick, last, {1}, Rejection::none},
      {"flag 2", tick, a_tick, last, {2}},
      {"flag 255", tick, a_tick, last, {255}},
      {"utime -1", participant, announced, 8, std::vector<int>(8, 255)},
      {"utime 9e15",
       participant,
       announced,
       8,
       {0, 0x1f, 0xf9, 0x73, 0xca, 0xfa, 0x80, 0},
       Rejection::none},
      {"utime 9e15 + 1", participant, announced, 8, {0, 0x1f, 0xf9, 0x73, 0xca, 0xfa, 0x80, 0x1}},
      {"state 5", participant, announced, participant_state, {5}},
      {"state 255", participant, announced, participant_state, {255}},
      {"error -1", participant, announced, participant_error_norm, {0xbf, 0xf0, 0, 0, 0, 0, 0, 0}},
      {"role Controller", participant, announced, role + 4, {'C'}},
      // "controller" has 11 characters with its NUL.
      {"length 0", participant, announced, role, {0, 0, 0, 0}, text},
      {"length -1", participant, announced, role, {255, 255, 255, 255}, text},
      {"length -2^31", participant, announced, role, {0x80, 0, 0, 0}, text},
      {"length 2^31-1", participant, announced, role, {0x7f, 255, 255, 255}, text},
      {"length 2^29", participant, announced, role, {0x20, 0, 0, 0}, text},
      {"length 1026", participant, announced, role, {0, 0, 4, 2}, text},
      {"length 10", participant, announced, role, {0, 0, 0, 10}, text},
      {"length 12", participant, announced, role, {0, 0, 0, 12}, text},
      {"no NUL", participant, announced, role + 4 + 10, {'x'}, text},
      {"NUL inside", participant, announced, role + 4 + 3, {0}, text},
      {"no ticks", run_info, a_run_info, body, zeros},
      {"no period", run_info, a_run_info, body + 8, zeros},
      // "0.1.0" has 6.
      {"length 5", run_info, a_run_info, version, {0, 0, 0, 5}, text},
      {"length 7", run_info, a_run_info, version, {0, 0, 0, 7}, text},
      {"length 1000", run_info, a_run_info, version, {0, 0, 3, 0xe8}, text}};
  for (const Altered& each : all) {
    Bytes bytes = each.message;
    for (std::size_t i = 0; i < each.bytes.size(); ++i) {
      bytes.at(each.at + i) = static_cast<std::byte>(each.bytes[i]);
    }
    EXPECT_EQ(each.verdict({}, bytes), each.expected) << each.what;
  }
}

TEST(ParticipantCodec, RejectsNonFiniteErrorNorm) {
  codec_checks::rejects_non_finite<ParticipantType>(participant_error_norm, 1, {});
}
// A line end in a signal's name was a command to gnuplot; one in any name is an order to a
// terminal.
TEST(ParticipantCodec, RejectsControlCharactersAndSignalsThatAreNoNames) {
  Random random;
  auto message = ParticipantType::message({}, random);
  message.signals = "error:rad,nu:rad/s\n!touch PWNED\n#";
  EXPECT_EQ(verdict<ParticipantType>({}, codec_checks::lcm_bytes(message)), Rejection::bad_text);
  message.signals = "er\"ror:rad";
  EXPECT_EQ(verdict<ParticipantType>({}, codec_checks::lcm_bytes(message)), Rejection::bad_text);
  message.signals = "error:rad";
  message.law = "\x1b[2J";
  EXPECT_EQ(verdict<ParticipantType>({}, codec_checks::lcm_bytes(message)), Rejection::bad_text);
  auto info = RunInfoType::message({}, random);
  EXPECT_EQ(verdict<RunInfoType>({}, codec_checks::lcm_bytes(info)), Rejection::none);
  info.scenario = "name: \x1b[2J\n";
  EXPECT_EQ(verdict<RunInfoType>({}, codec_checks::lcm_bytes(info)), Rejection::bad_text);
  Codec<loop::Participant> codec({});
  loop::Participant value;
  value.signals = "no unit";
  EXPECT_THROW(codec.encode({}, value), std::logic_error);
}
TEST(ParticipantCodec, CarriesTextsOfTheGreatestLengthAndRefusesLongerOnes) {
  Codec<loop::Participant> codec({});
  loop::Participant value;
  value.host = std::string(loop::max_participant_text, 'h');
  value.scenario = std::string(loop::max_participant_text, 's');
  value.measurement = std::string(loop::max_participant_text, 'm');
  value.fault = std::string(loop::max_participant_text, 'f');
  loop::Stamp stamp;
  loop::Participant got;
  ASSERT_EQ(codec.decode(codec.encode({}, value), stamp, got), Rejection::none);
  EXPECT_EQ(got.host, value.host);
  EXPECT_EQ(got.scenario, value.scenario);
  EXPECT_EQ(got.measurement, value.measurement);
  EXPECT_EQ(got.fault, value.fault);
  value.fault += 'x';
  EXPECT_THROW(codec.encode({}, value), std::length_error);

  Random random;
  auto message = ParticipantType::message({}, random);
  message.fault = value.fault;
  EXPECT_EQ(verdict<ParticipantType>({}, codec_checks::lcm_bytes(message)), Rejection::bad_text);
}
TEST(ParticipantCodec, RefusesToEncodeWhatItWouldNotDecode) {
  Codec<loop::Participant> codec({});
  loop::Participant value;
  EXPECT_NO_THROW(codec.encode({}, value));
  value.host = std::string("a\0b", 3);
  EXPECT_THROW(codec.encode({}, value), std::logic_error);
  value.host.clear();
  value.error_norm = -1;
  EXPECT_THROW(codec.encode({}, value), std::logic_error);
  value.error_norm = nan;
  EXPECT_THROW(codec.encode({}, value), std::domain_error);
  value.error_norm = 0;
  value.fault_code = 256;
  EXPECT_THROW(codec.encode({}, value), std::logic_error);
}
TEST(ParticipantCodec, CarriesEveryExitCode) {
  Codec<loop::Participant> codec({});
  for (int code = 0; code < 256; ++code) {
    loop::Participant value;
    value.fault_code = code;
    loop::Stamp stamp;
    loop::Participant got;
    ASSERT_EQ(codec.decode(codec.encode({}, value), stamp, got), Rejection::none);
    EXPECT_EQ(got.fault_code, code);
  }
}

TEST(RunInfoCodec, RejectsNonFinitePeriod) {
  codec_checks::rejects_non_finite<RunInfoType>(body + 8, 1, {});
}
TEST(RunInfoCodec, FitsOneDatagramOrIsRefused) {
  Codec<loop::RunInfo> codec({});
  loop::RunInfo value;
  value.num_ticks = 1;
  value.period_s = 1e-3;
  value.robot_description = std::string(loop::max_run_info_size - body - 16 - 7 * 5, 'x');
  EXPECT_EQ(codec.encode({}, value).size(), static_cast<std::size_t>(loop::max_run_info_size));
  value.scenario.push_back('y');
  EXPECT_THROW(codec.encode({}, value), std::length_error);

  Random random;
  auto message = RunInfoType::message({}, random);
  message.robot_description = value.robot_description;
  EXPECT_EQ(verdict<RunInfoType>({}, codec_checks::lcm_bytes(message)), Rejection::wrong_size);
}

TEST(Names, OfRejectionsAndRolesAreWhatTheHeaderSays) {
  EXPECT_EQ(name(Rejection::none), "none");
  EXPECT_EQ(name(Rejection::wrong_size), "wrong_size");
  EXPECT_EQ(name(Rejection::wrong_type), "wrong_type");
  EXPECT_EQ(name(Rejection::wrong_count), "wrong_count");
  EXPECT_EQ(name(Rejection::non_finite), "non_finite");
  EXPECT_EQ(name(Rejection::bad_text), "bad_text");
  EXPECT_EQ(name(Rejection::bad_value), "bad_value");
  EXPECT_EQ(name(loop::Role::plant), "plant");
  EXPECT_EQ(name(loop::Role::reference), "reference");
  EXPECT_EQ(name(loop::Role::controller), "controller");
  EXPECT_EQ(name(loop::Role::logger), "logger");
}
TEST(Channels, AreUpperSnakeWithTheRobotsName) {
  EXPECT_EQ(loop::channel<loop::PositionMeasurement>("ARM"), "ARM_POSITION");
  EXPECT_EQ(loop::channel<loop::RunInfo>("ARM"), "ARM_RUN_INFO");
}

TEST(Fingerprint, IsReadFromTheFirstEightBytes) {
  const std::vector<std::byte> bytes = {std::byte{1}, std::byte{0}, std::byte{0}, std::byte{0},
                                        std::byte{0}, std::byte{0}, std::byte{0}, std::byte{2}};
  EXPECT_EQ(fingerprint_of(bytes), (std::int64_t{1} << 56) + 2);
  EXPECT_EQ(fingerprint_of(std::span(bytes).first(7)), std::nullopt);
}

}  // namespace
}  // namespace tachless::bus
