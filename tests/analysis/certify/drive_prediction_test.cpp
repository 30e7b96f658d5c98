// Tests of the page of certify with a loop inside the drives.
#include "certify/drive_prediction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "certify/certify.h"
#include "tests/analysis/linear/scenarios.h"

namespace tachless::certify::drive_prediction_test {
namespace {

using linear::testing::shipped;
using ::testing::AllOf;
using ::testing::HasSubstr;

scenario::Scenario with_drives() {
  return shipped("practical_rigid",
                 {"plant.drive.loop={period_s: 1.0e-4, kp: [4000, 400], kd: [300, 30], "
                  "velocity_filter_hz: 200, resolution_bits: 14}",
                  "controller.gains.kp=[10, 1]", "controller.gains.kd=[1, 0.1]"});
}

TEST(DrivePrediction, HasTheMarginsTheHostsDelayAndTheTorqueOfACount) {
  const Certificate found = certify(with_drives());
  EXPECT_TRUE(found.loop.stable);
  EXPECT_NEAR(found.loop.stiffness[0], 4010, 1e-3) << "of both loops together";
  ASSERT_TRUE(found.drives);
  EXPECT_GT(found.drives->margins.gain, 10);
  EXPECT_GT(found.drives->margins.modulus, 0.5);
  EXPECT_NEAR(found.drives->count_Nm[0], 130, 1) << "of 339,000 N m/rad and 14 bits";
  EXPECT_FALSE(found.stability) << "no proof contains this loop";
  const std::string page = certify::page(found, with_drives(), false);
  EXPECT_THAT(page, AllOf(HasSubstr("margins of drives"), HasSubstr("host delay"),
                          HasSubstr("count of drives"), HasSubstr("plant.drive.loop")));
}

TEST(DrivePrediction, IsNotThereWithoutTheKey) {
  const Certificate found = certify(shipped("practical_rigid"));
  EXPECT_FALSE(found.drives);
}

}  // namespace
}  // namespace tachless::certify::drive_prediction_test
