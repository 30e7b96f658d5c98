#include "messages/truth/truth_wire.h"

#include <gmock/gmock.h>

#include <limits>
#include <tachless_truth/arm_torque_t.hpp>
#include <tachless_truth/contact_t.hpp>
#include <tachless_truth/plant_truth_t.hpp>

#include "tests/core/messages/codec_checks.h"
#include "tests/support/counting_new.h"

namespace tachless::messages::truth {
namespace {

using codec_checks::body;
using codec_checks::Bytes;
using codec_checks::sample;
using codec_checks::verdict;

constexpr std::size_t reals = body + 8;

using ContactType = codec_checks::Pair<messages::truth::Contact, tachless_truth::contact_t>;
using ArmTorqueType = codec_checks::Pair<messages::truth::ArmTorque, tachless_truth::arm_torque_t>;
using TruthType = codec_checks::Pair<messages::truth::PlantTruth, tachless_truth::plant_truth_t>;

TEST(TruthCodec, AgreesWithGeneratedCodeByteForByte) {
  codec_checks::agrees_with_generated_code<TruthType>();
}
TEST(TruthCodec, PutsEveryFieldInItsOwnMember) {
  using codec_checks::reals_of;
  const messages::Layout layout{7, 7, 1};
  const auto message = codec_checks::message_of<TruthType>(layout);
  const auto value = codec_checks::random_value<messages::truth::PlantTruth>(layout);
  EXPECT_EQ(reals_of(value.q), message.position);
  EXPECT_EQ(reals_of(value.v), message.velocity);
  EXPECT_EQ(reals_of(value.theta), message.motor_position);
  EXPECT_EQ(reals_of(value.thetadot), message.motor_velocity);
  EXPECT_EQ(reals_of(value.tau), message.torque);
  EXPECT_EQ(reals_of(value.disturbance), message.disturbance);
  for (std::size_t i = 0; i < 7; ++i) EXPECT_EQ(value.saturated[i], message.saturated[i] == 1);
  EXPECT_EQ(value.fault, messages::truth::DriveFault::protective_stop);
}
TEST(TruthCodec, SurvivesEveryCutAndEveryFlippedBit) { codec_checks::survives_damage<TruthType>(); }
TEST(TruthCodec, RejectsAnotherTypesFingerprint) {
  codec_checks::rejects_other_fingerprint<TruthType>();
}
TEST(TruthCodec, RejectsHostileCounts) {
  codec_checks::rejects_counts<TruthType>(body, {2, 2, 1});
  codec_checks::rejects_counts<TruthType>(body + 4, {2, 2, 1});
  codec_checks::rejects_counts<TruthType>(body + 4, {2, 0, 1});
}
TEST(TruthCodec, RejectsNonFiniteReals) {
  codec_checks::rejects_non_finite<TruthType>(reals, 18, {3, 3, 1});
}
TEST(TruthCodec, RejectsAFlagThatIsNeitherZeroNorOneAndAFaultThatIsNone) {
  const messages::Layout layout{3, 0, 1};
  Bytes bytes = sample<TruthType>(layout);
  bytes.at(reals + 8 * 12 + 2) = std::byte{2};
  EXPECT_EQ(verdict<TruthType>(layout, bytes), Rejection::bad_value);
  for (const int fault : {3, 127, 128, 255}) {
    bytes = sample<TruthType>(layout);
    bytes.back() = static_cast<std::byte>(fault);
    EXPECT_EQ(verdict<TruthType>(layout, bytes), Rejection::bad_value) << fault;
  }
}
TEST(TruthCodec, DoesNotAllocateOnceConstructed) {
  for (const messages::Layout& layout : codec_checks::layouts()) {
    const Bytes bytes = sample<TruthType>(layout);
    Codec<messages::truth::PlantTruth> codec(layout);
    messages::Stamp stamp;
    messages::truth::PlantTruth value;
    const std::size_t before = allocations;
    for (int i = 0; i < 3; ++i) {
      ASSERT_EQ(codec.decode(bytes, stamp, value), Rejection::none);
      ASSERT_EQ(codec.encode(stamp, value).size(), bytes.size());
    }
    EXPECT_EQ(allocations, before);
  }
}
TEST(TruthCodec, LeavesNothingOfAnEarlierMessageBehind) {
  messages::Stamp stamp;
  messages::truth::PlantTruth value;
  value.saturated.fill(true);
  const messages::Layout flexible{2, 2, 1};
  const messages::Layout rigid{2, 0, 1};
  ASSERT_EQ(Codec<messages::truth::PlantTruth>(flexible).decode(sample<TruthType>(flexible), stamp,
                                                                value),
            Rejection::none);
  ASSERT_EQ(
      Codec<messages::truth::PlantTruth>(rigid).decode(sample<TruthType>(rigid), stamp, value),
      Rejection::none);
  EXPECT_EQ(value.theta.size(), 0);
  EXPECT_EQ(value.thetadot.size(), 0);
  for (std::size_t i = 2; i < value.saturated.size(); ++i) EXPECT_FALSE(value.saturated[i]);
}
TEST(TruthCodec, RefusesToEncodeWhatIsNotFiniteOrOfAnotherSize) {
  Codec<messages::truth::PlantTruth> codec({2, 0, 1});
  const Vector zero = Vector::Zero(2);
  messages::truth::PlantTruth value{zero, zero, {}, {}, zero, zero};
  EXPECT_NO_THROW(codec.encode({}, value));
  EXPECT_THROW(Codec<messages::truth::PlantTruth>({2, 2, 1}).encode({}, value), std::logic_error);
  value.v[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(all_finite(value));
  EXPECT_THROW(codec.encode({}, value), std::domain_error);
}
TEST(ContactCodec, AgreesWithGeneratedCodeByteForByte) {
  codec_checks::agrees_with_generated_code<ContactType>();
}
TEST(ContactCodec, PutsEveryFieldInItsOwnMember) {
  const auto message = codec_checks::message_of<ContactType>({2, 0, 1});
  EXPECT_EQ(message.simulator, "simulator");
  EXPECT_EQ(message.geoms, "geoms");
  EXPECT_EQ(message.force, codec_checks::random_value<messages::truth::Contact>({2, 0, 1}).force);
}
TEST(ContactCodec, SurvivesEveryCutAndEveryFlippedBit) {
  codec_checks::survives_damage<ContactType>();
}
TEST(ArmTorqueCodec, AgreesWithGeneratedCodeByteForByte) {
  codec_checks::agrees_with_generated_code<ArmTorqueType>();
}
TEST(ArmTorqueCodec, PutsEveryFieldInItsOwnMember) {
  const messages::Layout layout{7, 0, 1};
  const auto message = codec_checks::message_of<ArmTorqueType>(layout);
  const auto value = codec_checks::random_value<messages::truth::ArmTorque>(layout);
  EXPECT_EQ(codec_checks::reals_of(value.accepted), message.accepted);
  EXPECT_EQ(codec_checks::reals_of(value.measured), message.measured);
  EXPECT_EQ(message.told, 3);
}
TEST(ArmTorqueCodec, SurvivesEveryCutAndEveryFlippedBit) {
  codec_checks::survives_damage<ArmTorqueType>();
}
TEST(ArmTorqueCodec, RejectsATorqueThatNobodyTells) {
  const messages::Layout layout{2, 0, 1};
  for (const int told : {0, 4, 255}) {
    Bytes bytes = sample<ArmTorqueType>(layout);
    bytes.back() = static_cast<std::byte>(told);
    EXPECT_EQ(verdict<ArmTorqueType>(layout, bytes), Rejection::bad_value) << told;
  }
}
TEST(TruthChannel, IsItsOwn) {
  EXPECT_EQ(messages::channel<messages::truth::ArmTorque>("ARM"), "ARM_ARM_TORQUE");
  EXPECT_EQ(messages::channel<messages::truth::Contact>("ARM"), "ARM_CONTACT");
  EXPECT_EQ(messages::channel<messages::truth::PlantTruth>("ARM"), "ARM_TRUTH");
}

}  // namespace
}  // namespace tachless::messages::truth
