#include "messages/measurements.h"

#include <gmock/gmock.h>

namespace tachless::messages {
namespace {

TEST(Measurements, HoldWhatTheirFieldsSay) {
  EXPECT_THAT(measurement_suffixes, testing::ElementsAre("POSITION", "MOTOR_POSITION",
                                                         "BOTH_POSITIONS", "LINK_STATE", "STATE"));
  EXPECT_TRUE(holds_links<PositionMeasurement>);
  EXPECT_FALSE(holds_motors<PositionMeasurement>);
  EXPECT_FALSE(measures_velocity("POSITION"));
  EXPECT_FALSE(holds_links<MotorPositionMeasurement>);
  EXPECT_TRUE(holds_motors<MotorPositionMeasurement>);
  EXPECT_FALSE(measures_velocity("MOTOR_POSITION"));
  EXPECT_TRUE(holds_links<BothPositionsMeasurement>);
  EXPECT_TRUE(holds_motors<BothPositionsMeasurement>);
  EXPECT_FALSE(measures_velocity("BOTH_POSITIONS"));
  EXPECT_TRUE(measures_velocity("LINK_STATE"));
  EXPECT_TRUE(measures_velocity("STATE"));
  EXPECT_FALSE(measures_velocity("VELOCITY"));
}

TEST(Measurements, AreFoundBySuffix) {
  int calls = 0;
  EXPECT_TRUE(with_measurement("LINK_STATE", [&]<class M>(std::type_identity<M>) {
    EXPECT_TRUE((std::is_same_v<M, LinkStateMeasurement>));
    ++calls;
  }));
  EXPECT_FALSE(with_measurement("COMMAND", [&](auto) { ++calls; }));
  EXPECT_EQ(calls, 1);
}

TEST(Measurements, AreMadeEmptyBySuffix) {
  for (std::size_t i = 0; i < measurement_suffixes.size(); ++i) {
    EXPECT_EQ(measurement_of(measurement_suffixes.at(i)).value().index(), i);
  }
  EXPECT_FALSE(measurement_of("COMMAND").has_value());
}

TEST(Measurements, AGreaterOneHoldsALesserOne) {
  EXPECT_TRUE((is_part_of<PositionMeasurement, StateMeasurement>()));
  EXPECT_TRUE((is_part_of<LinkStateMeasurement, StateMeasurement>()));
  EXPECT_FALSE((is_part_of<StateMeasurement, LinkStateMeasurement>()));
  EXPECT_TRUE((is_part_of<BothPositionsMeasurement, LinkStateMeasurement>()));
  EXPECT_FALSE((is_part_of<MotorPositionMeasurement, PositionMeasurement>()));
  const auto at = [](double x) -> Vector { return Vector::Constant(2, x); };
  const StateMeasurement state{at(1), at(2), at(3), at(4)};
  const auto link = part_of<LinkStateMeasurement>(state);
  EXPECT_EQ(link.q, at(1));
  EXPECT_EQ(link.v, at(2));
  EXPECT_EQ(link.theta, at(3));
}

}  // namespace
}  // namespace tachless::messages
