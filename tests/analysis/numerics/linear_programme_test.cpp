#include "numerics/linear_programme.h"

#include <gtest/gtest.h>

#include <random>

namespace tachless::numerics {
namespace {

/// Returns a programme with `rows` random half-spaces that leave the origin `room`.
LinearProgramme random_programme(int variables, int rows, double room, unsigned seed) {
  std::mt19937 engine(seed);
  std::normal_distribution<double> normal;
  const auto random = [&] {
    return Eigen::VectorXd::NullaryExpr(variables, [&] { return normal(engine); }).eval();
  };
  LinearProgramme programme{random(),
                            Eigen::VectorXd::Constant(variables, -10),
                            Eigen::VectorXd::Constant(variables, 10),
                            {}};
  for (int i = 0; i < rows; ++i) programme.rows.push_back({random(), -room});
  return programme;
}

TEST(LinearProgramme, OfManyRowsHasTheOptimumOfAllRowsAtOnce) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const LinearProgramme programme = random_programme(8, 2000, 1, seed);
    const auto all = solution(programme), grown = solution_of_many_rows(programme);
    ASSERT_TRUE(all && grown);
    // Random rows have one optimal vertex. Clp's tolerance is 1e-7.
    EXPECT_LT((all->x - grown->x).norm(), 1e-6);
    EXPECT_LT((all->price - grown->price).norm(), 1e-6);
    double binding = 0;
    for (std::size_t i = 0; i < programme.rows.size(); ++i) {
      const auto& row = programme.rows[i];
      EXPECT_GT(row.gradient.dot(grown->x) - row.least, -1e-6) << i;
      binding += grown->price[static_cast<Eigen::Index>(i)] > 0 ? 1 : 0;
    }
    EXPECT_LE(binding, 8);
  }
}

TEST(LinearProgramme, OfManyRowsHasNoOptimumWhereNoneIsFeasible) {
  // Half-spaces that leave the origin out on all sides have no point in common.
  const LinearProgramme programme = random_programme(8, 2000, -1, 1);
  EXPECT_FALSE(solution(programme));
  EXPECT_FALSE(solution_of_many_rows(programme));
}

}  // namespace
}  // namespace tachless::numerics
