#include "tests/campaign/forger.h"

#include <gtest/gtest.h>

#include <map>
#include <set>

#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "loop/messages.h"

namespace tachless::campaign {
namespace {

constexpr loop::Layout layout{.num_joints = 2, .num_motors = 0, .num_signals = 2};

template <class Value>
Sent message(Value value) {
  bus::Codec<Value> codec(layout);
  const auto bytes = codec.encode({1000, 7, 1}, value);
  return {loop::channel<Value>("ARM"), {bytes.begin(), bytes.end()}};
}

template <class Value>
bus::Rejection check(const std::vector<std::byte>& payload) {
  loop::Stamp stamp;
  Value value;
  return bus::Codec<Value>(layout).decode(payload, stamp, value);
}

const robot::Vector two = robot::Vector::Ones(2);

loop::truth::PlantTruth truth() {
  loop::truth::PlantTruth truth;
  truth.q = truth.v = truth.tau = truth.disturbance = two;
  return truth;
}

TEST(Fields, CoverEveryByteOfAMessage) {
  loop::Participant who;
  who.host = "arm-1";
  for (const Sent& each :
       {message(loop::TorqueCommand{two}), message(who), message(truth()), message(loop::LogAck{}),
        message(loop::ReferencePoint{two, two, two, two, two})}) {
    std::size_t end = 0;
    for (const FieldAt& field : fields_of(each.channel, each.payload)) {
      // Between two fields there is at most the end of a text.
      EXPECT_LE(field.offset - end, 1U) << each.channel << " " << field.name;
      end = field.offset + field.size;
    }
    EXPECT_LE(each.payload.size() - end, 1U) << each.channel;
  }
  EXPECT_TRUE(fields_of("ARM_NONE", {}).empty());
  EXPECT_TRUE(fields_of("ARM_TICK", {}).empty());
}

TEST(AForger, ContradictsWithWhatPassesEveryCheck) {
  Forger forger(1);
  const Sent command = message(loop::TorqueCommand{two});
  const auto other = forger.contradict(command);
  EXPECT_NE(other, command.payload);
  EXPECT_EQ(check<loop::TorqueCommand>(other), bus::Rejection::none);
  const Sent said = message(truth());
  EXPECT_EQ(check<loop::truth::PlantTruth>(forger.contradict(said)), bus::Rejection::none);
  EXPECT_NE(forger.contradict(said), said.payload);
  EXPECT_EQ(check<loop::Participant>(forger.contradict(message(loop::Participant{}))),
            bus::Rejection::none);
}

TEST(AForger, ForgesSoThatEveryCheckIsTried) {
  Forger forger(2);
  const Sent command = message(loop::TorqueCommand{two});
  const Sent who = message(loop::Participant{});
  std::map<bus::Rejection, int> seen;
  for (int i = 0; i < 3000; ++i) {
    ++seen[check<loop::TorqueCommand>(forger.forge(command))];
    ++seen[check<loop::Participant>(forger.forge(who))];
    ++seen[check<loop::TorqueCommand>(forger.damage(command))];
  }
  for (const auto rejection :
       {bus::Rejection::none, bus::Rejection::wrong_size, bus::Rejection::wrong_type,
        bus::Rejection::wrong_count, bus::Rejection::non_finite, bus::Rejection::bad_text,
        bus::Rejection::bad_value}) {
    EXPECT_GT(seen[rejection], 20) << bus::name(rejection);
  }
}

TEST(AForger, MakesTheSameOfTheSameSeed) {
  Forger one(3);
  Forger other(3);
  const Sent who = message(loop::Participant{});
  for (int i = 0; i < 100; ++i) EXPECT_EQ(one.forge(who), other.forge(who));
}

}  // namespace
}  // namespace tachless::campaign
