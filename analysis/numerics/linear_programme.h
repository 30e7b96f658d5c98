#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace tachless::numerics {

/// The smallest cost' x with lower <= x <= upper and gradient' x >= least in each row.
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
  Eigen::VectorXd price;  ///< of each row: what the cost rises by when `least` does by 1
};

/// By the dual simplex method of COIN-OR's Clp. Nothing when there is no x.
std::optional<Optimum> solution(const LinearProgramme& programme);

}  // namespace tachless::numerics
