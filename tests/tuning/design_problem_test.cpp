#include "tuning/design_problem.h"

#include <gtest/gtest.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>

#include "tests/certificate/scenarios.h"

namespace tachless::tuning {
namespace {

using namespace certificate::testing;

/// A member was read before it was initialised: one run in three of the same input designed other
/// gains.
TEST(DesignProblem, DoesNotDependOnWhatWasInItsMemory) {
  const experiment::Scenario scenario = shipped("practical_rigid");
  const auto feedback = [&](std::uint64_t step) {
    alignas(DesignProblem) std::array<std::uint64_t, sizeof(DesignProblem) / 8 + 1> memory{};
    for (std::size_t i = 0; i < memory.size(); ++i) memory[i] = i * step;
    const std::unique_ptr<DesignProblem, decltype(&std::destroy_at<DesignProblem>)> problem(
        new (memory.data()) DesignProblem(scenario, {}), &std::destroy_at<DesignProblem>);
    return Eigen::MatrixXd(
        problem->loop().at(rest_in_range(problem->model(), 1)).law(scenario.loop.period_s).D);
  };
  EXPECT_EQ(feedback(0), feedback(256));  // as flags false, as pointers different
}

}  // namespace
}  // namespace tachless::tuning
