// Friction in the matrix condition, and what of it only bounds the errors.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "certify/certify.h"
#include "tests/analysis/linear/scenarios.h"

namespace tachless::lyapunov::friction_test {
namespace {

using namespace linear;
using namespace linear::testing;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(Friction, IsInTheConditionAndWhatIsNotFedForwardBoundsTheErrors) {
  const std::vector<std::string> damped = {"plant.drive.viscous_friction_Nms_per_rad=[30, 5]"};
  const auto fastest = [](const std::vector<std::string>& overrides) {
    std::string why_not;
    auto found = stability_certificate(linear::testing::shipped("practical_rigid", overrides),
                                       linear::Effort::full, why_not);
    return std::pair(*found->fastest, found->provisos);
  };
  const auto [none, no_proviso] = fastest({});
  const auto [exact, exact_provisos] = fastest({damped[0], "controller.friction.viscous=[30, 5]"});
  const auto [missing, missing_provisos] = fastest(damped);
  EXPECT_GT(exact.rate, none.rate) << "damping helps";
  EXPECT_FALSE(exact.friction_error);
  EXPECT_THAT(exact_provisos, ::testing::IsEmpty());
  ASSERT_TRUE(missing.friction_error);
  EXPECT_EQ(missing_provisos.size(), 1U);
  const auto dry = fastest({"plant.drive.coulomb_friction_Nm=[0.05, 0.01]",
                            "controller.friction.coulomb=[0.05, 0.01]"})
                       .first;
  ASSERT_TRUE(dry.friction_error);
  RecordProperty("missing", certify::list_text(*missing.friction_error));
  RecordProperty("dry", certify::list_text(*dry.friction_error));
}

/// Each further term of friction, of the plant and fed forward, widens the errors that end.
TEST(Friction, ThatRisesOrGrowsWithTheLoadWidensTheErrors) {
  const auto last_error = [](const std::vector<std::string>& more) {
    std::vector<std::string> overrides = {"plant.drive.coulomb_friction_Nm=[0.05, 0.01]",
                                          "controller.friction.coulomb=[0.05, 0.01]"};
    overrides.insert(overrides.end(), more.begin(), more.end());
    std::string why_not;
    const auto found = stability_certificate(linear::testing::shipped("practical_rigid", overrides),
                                             linear::Effort::full, why_not);
    return (*found->fastest->friction_error)[0];
  };
  const double before = last_error({});
  for (const char* term :
       {"plant.drive.friction_rise_Nm=[0.02, 0]", "plant.drive.friction_rise_Nm=[-0.02, 0]",
        "plant.drive.load_friction=[1e-4, 0]", "controller.friction.rise=[0.02, 0]",
        "controller.friction.load=[1e-4, 0]"}) {
    EXPECT_GT(last_error({term}), 1.01 * before) << term;
  }
}

/// The provisos name offset, eccentricity and the friction of motors and springs.
TEST(Friction, AndOffsetsThatTheConditionLeavesOutAreNamed) {
  const auto provisos = [](const std::string& scenario, const std::string& value) {
    std::string why_not;
    return stability_certificate(linear::testing::shipped(scenario, {value}), linear::Effort::quick,
                                 why_not)
        ->provisos;
  };
  const std::string joints = "robot.joints.flexible.";
  ASSERT_THAT(provisos("practical_rigid", "name=as_it_is"), ::testing::IsEmpty());
  EXPECT_THAT(provisos("practical_rigid", "plant.drive.torque_offset_Nm=[1, 0]"),
              ElementsAre(HasSubstr("the torques' offset (plant.drive) is not in it")));
  EXPECT_THAT(provisos("practical_rigid", "plant.encoder.eccentricity_rad=1e-3"),
              ElementsAre(HasSubstr("eccentricity is not in it")));
  for (const char* friction : {"motor_damping_Nms_per_rad=1", "motor_coulomb_friction_Nm=1",
                               "spring_damping_Nms_per_rad=1"}) {
    EXPECT_THAT(provisos("practical_flexible", joints + friction),
                ElementsAre("the friction of joints, motors and springs is not in it"));
  }
}

}  // namespace
}  // namespace tachless::lyapunov::friction_test
