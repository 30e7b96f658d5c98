#include "certificate/lyapunov.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <type_traits>

#include "controller/laws.h"
#include "controller/registry.h"
#include "robot/mass_matrix.h"

namespace tachless::certificate {
namespace {

/// The largest eigenvalue of M over postures spread evenly over the joints' ranges.
double largest_inertia(const robot::Model& model) {
  constexpr int num_postures = 256;
  // Fractional parts of multiples of roots of primes: Kronecker's sequence.
  constexpr std::array<int, 12> primes = {2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37};
  double largest = 0;
  for (int k = 0; k < num_postures; ++k) {
    robot::Vector q(model.num_joints);
    for (int i = 0; i < model.num_joints; ++i) {
      const auto joint = static_cast<std::size_t>(i);
      const double step = std::sqrt(primes[joint % primes.size()] + i / 12);
      const double part = k * step - std::floor(k * step);
      const double range =
          model.joint_types[joint] == robot::JointType::revolute ? std::numbers::pi : 1.0;
      const double low = std::isfinite(model.lower[i]) ? model.lower[i] : -range;
      const double high = std::isfinite(model.upper[i]) ? model.upper[i] : range;
      q[i] = low + part * (high - low);
    }
    const robot::Matrix M = robot::mass_matrix(model, q);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(M, Eigen::EigenvaluesOnly);
    largest = std::max(largest, solver.eigenvalues().maxCoeff());
  }
  return largest;
}

template <class L>
robot::Model links_of(const experiment::Scenario& scenario) {
  if constexpr (std::is_same_v<typename L::Robot, controller::law::FlexibleRobot>) {
    return controller::flexible_robot(scenario).links;
  } else {
    return controller::rigid_model(scenario);
  }
}

template <class L>
std::optional<LyapunovFunction> function_of(const experiment::Scenario& scenario) {
  if constexpr (controller::law::HasLyapunovFunction<L>) {
    const auto law = std::make_shared<const L>(controller::make_law<L>(scenario));
    double epsilon = 0;
    if constexpr (controller::law::HasCrossTerm<L>) {
      epsilon = 0.05 * law->epsilon_bound(largest_inertia(links_of<L>(scenario)));
    }
    return LyapunovFunction{
        std::string(L::lyapunov_formula), epsilon,
        [law, epsilon](const LoopState& state, const loop::ReferencePoint& reference) {
          return law->lyapunov(state, reference, epsilon);
        }};
  } else {
    return {};
  }
}

}  // namespace

std::optional<LyapunovFunction> lyapunov_function(const experiment::Scenario& scenario) {
  std::optional<LyapunovFunction> function;
  const auto look_up = [&]<class... L>(controller::LawList<L...> /*laws*/) {
    const auto take = [&]<class Law>(std::type_identity<Law> /*law*/) {
      if (scenario.controller.law == Law::name) function = function_of<Law>(scenario);
    };
    (take(std::type_identity<L>{}), ...);
  };
  look_up(controller::Laws{});
  return function;
}

}  // namespace tachless::certificate
