// Friction in the matrix condition, and what of it only bounds the errors.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "certificate/certify.h"
#include "tests/certificate/scenarios.h"

namespace tachless::certificate {
namespace {

using namespace testing;

TEST(Friction, IsInTheConditionAndWhatIsNotFedForwardBoundsTheErrors) {
  const std::vector<std::string> damped = {"plant.drive.viscous_friction_Nms_per_rad=[30, 5]"};
  const auto fastest = [](const std::vector<std::string>& overrides) {
    std::string why_not;
    auto found =
        stability_certificate(shipped("practical_rigid", overrides), Effort::full, why_not);
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
  RecordProperty("missing", list_text(*missing.friction_error));
  RecordProperty("dry", list_text(*dry.friction_error));
}

}  // namespace
}  // namespace tachless::certificate
