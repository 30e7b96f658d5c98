#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace tachless::numerics {

/// Linear programme: minimise cost' x with lower <= x <= upper and gradient' x >= least for each
/// row.
struct LinearProgramme {
  struct Row {
    Eigen::VectorXd gradient;
    double least = 0;
  };
  Eigen::VectorXd cost, lower, upper;
  std::vector<Row> rows;
};

struct Optimum {
  Eigen::VectorXd x;
  Eigen::VectorXd price;  ///< of each row: increase of the cost per increase of `least`
};

/// Solves the programme with the dual simplex method of COIN-OR's Clp. Returns nothing when no x is
/// feasible.
std::optional<Optimum> solution(const LinearProgramme& programme);

/// Does the same for a hundred times as many rows as variables. It begins without rows; those that
/// the optimum violates join until none does.
/// Precondition: the bounds alone bound the cost from below.
std::optional<Optimum> solution_of_many_rows(const LinearProgramme& programme);

}  // namespace tachless::numerics
