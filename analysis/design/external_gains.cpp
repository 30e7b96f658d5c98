// The parts of DesignProblem that concern external laws: their gains as the variables of a search.

#include <algorithm>
#include <cmath>
#include <set>
#include <string>

#include "base/failure.h"
#include "design/design_problem.h"
#include "linear/linear_loop.h"
#include "numerics/decompositions.h"

namespace tachless::design {

using base::ExitCode;
using base::Failure;
using Eigen::Index;
using Eigen::VectorXd;
using messages::ReferencePoint;
namespace {

/// Returns the largest difference of the two frequency responses, relative to the second.
double unlike(const linear::LinearLaw& one, const linear::LinearLaw& other, double period_s) {
  double most = 0;
  for (const double turn : {0.01, 0.1, 1.0}) {
    const auto response = [&](const linear::LinearLaw& law) -> Eigen::MatrixXcd {
      return linear::at_frequency({law, {}, false}, turn / period_s, period_s).K;
    };
    most = std::max(most, (response(one) - response(other)).norm() / response(other).norm());
  }
  return most;
}

}  // namespace

/// Makes each number of the scenario's gains a variable: the logarithm of its ratio to the
/// scenario's value. Matrices do not vary.
void DesignProblem::choose_entries() {
  by_joint_ = false;
  for (const auto& [name, value] : start_) {
    if (value.size() != model_.num_joints) continue;
    const bool alike = (value.array() == value[0]).all();
    for (Index j = 0; j < (alike ? 1 : value.size()); ++j) {
      if (value[j] == 0) continue;
      kinds_.push_back(name);
      entries_.push_back(alike ? -1 : j);
    }
  }
  const linear::LinearLaw first = feedback_at(start_, rests_.front());
  const double h = scenario_.loop.period_s;
  Gains other = start_;
  for (std::size_t kind = 0; kind < kinds_.size(); ++kind) scale(other, kind, 1.01);
  if (unlike(feedback_at(other, rests_.front()), first, h) < 1e-9) {
    throw Failure(
        ExitCode::check_said_no, "design varies the scenario's controller.gains, and {}",
        kinds_.empty() ? "there is none but 0" : "the program's torques are the same with others");
  }
  const ReferencePoint beside = rest_in_range(model_, mean_postures);
  problem_.same_everywhere = unlike(feedback_at(start_, beside), first, h) < 1e-5;
}

/// Bounds each number so that the law gets no further pole faster than 1/3. The pole 1/3 is that of
/// a filter of rate 1 / h under Tustin's rule. Each number is moved alone.
void DesignProblem::bound_poles() {
  const auto fast_poles = [&](std::size_t kind, double log_factor) {
    Gains moved = start_;
    scale(moved, kind, std::exp(log_factor));
    const Eigen::MatrixXd A = feedback_at(moved, rests_.front()).A;
    return A.size() == 0 ? Index(0) : (numerics::eigenvalues(A).real().array() < 0.333).count();
  };
  const Index as_given = fast_poles(0, 0);
  for (std::size_t kind = 0; kind < kinds_.size(); ++kind) {
    const auto no_faster = [&](double by) { return fast_poles(kind, by) <= as_given; };
    for (VectorXd* bounds : {&problem_.upper, &problem_.lower}) {
      double& bound = (*bounds)[static_cast<Index>(kind)];
      if (!no_faster(bound)) bound = linear::edge(0, bound, 7, no_faster);
    }
  }
}

std::vector<VectorXd> DesignProblem::beside(const VectorXd& theta) const {
  std::vector<VectorXd> all;
  for (const std::string& name : std::set(kinds_.begin(), kinds_.end())) {
    for (const double factor : {2.0, 0.5}) {
      VectorXd& start = all.emplace_back(theta);
      for (std::size_t i = 0; i < kinds_.size(); ++i) {
        if (kinds_[i] == name) start[static_cast<Index>(i)] += std::log(factor);
      }
      start = start.cwiseMax(problem_.lower).cwiseMin(problem_.upper);
    }
  }
  return all;
}

}  // namespace tachless::design
