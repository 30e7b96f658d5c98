#pragma once

#include <Eigen/Core>
#include <functional>

namespace tachless::certificate {

/// Where a local minimum was found.
struct Minimum {
  Eigen::VectorXd x;
  double value = 0;
};

/// Local minimisation without derivatives (NLopt's Subplex) from `start` with first steps `step`.
/// `f` may return +infinity where it has no value. Not global: the caller chooses the starts.
Minimum minimise(const std::function<double(const Eigen::VectorXd&)>& f,
                 const Eigen::VectorXd& start, double step, int max_evaluations);

}  // namespace tachless::certificate
