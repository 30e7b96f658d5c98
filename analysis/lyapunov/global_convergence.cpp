#include "lyapunov/global_convergence.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <string_view>

#include "controller/laws.h"
#include "controller/registry.h"
#include "lyapunov/law_loop.h"
#include "numerics/decompositions.h"
#include "numerics/postures.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"

namespace tachless::lyapunov {
namespace {

using Eigen::VectorXd;
using namespace controller::law;

/// Returns whether the reference ends at rest. Sums of sines do not.
bool comes_to_rest(const scenario::Scenario& scenario) {
  return reference::sines_of(scenario.reference).empty();
}

/// Least eigenvalue of D + sym C(q, v_ref), and the joint in which its eigenvector is largest.
struct LeastDamping {
  double value = infinity;
  Eigen::Index joint = 0;
};

LeastDamping least_damping(const scenario::Scenario& scenario, const VectorXd& D) {
  constexpr int instants = 65, postures = 256;
  const robot::Model model = error_model(scenario);
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  LeastDamping least;
  for (const double t_s : reference::Motion(scenario, trajectory).closely(instants)) {
    const messages::ReferencePoint r = trajectory.at(t_s);
    for (int k = 0; k <= postures; ++k) {
      const Vector q = k == 0 ? r.q_ref : numerics::spread_posture(model, k);
      const Eigen::MatrixXd C = robot::coriolis_matrix(model, q, r.v_ref);
      const auto [values, vectors] =
          numerics::symmetric_eigen(symmetric_part(C) + Eigen::MatrixXd(D.asDiagonal()));
      if (values[0] >= least.value) continue;
      least.value = values[0];
      vectors.col(0).cwiseAbs().maxCoeff(&least.joint);
    }
  }
  return least;
}

}  // namespace

std::optional<GlobalConvergence> global_convergence(const scenario::Scenario& scenario) {
  const std::string_view law = scenario.controller.law;
  const bool matrix = law == LoriaOrtegaMatrix::name;
  if (!matrix && law != LoriaOrtegaRigid::name && law != LoriaOrtegaBounded::name &&
      law != KellyRegulation::name) {
    return std::nullopt;
  }
  if (law == LoriaOrtegaBounded::name &&
      controller::make_law<LoriaOrtegaBounded>(scenario).integral() != nullptr) {
    return std::nullopt;
  }
  if (comes_to_rest(scenario)) return GlobalConvergence{true, "the reference comes to rest", {}};
  if (matrix) return GlobalConvergence{false, "matrices Kp and Kd, and the reference moves", {}};
  const VectorXd D = scenario.plant.drive.viscous_friction_Nms_per_rad;
  const LeastDamping least = least_damping(scenario, D);
  const std::string joint =
      robot::joint_labels(*scenario.model).joint(static_cast<std::size_t>(least.joint));
  if (least.value <= 0) {
    return GlobalConvergence{
        false,
        fmt::format("friction lacks {:.2g} N m s/rad to outweigh C(q, v_ref), at {}", -least.value,
                    joint),
        least.value};
  }
  const controller::FrictionSpec& forward = scenario.controller.friction;
  if (!forward.given() || VectorXd(forward.viscous) != D) {
    return GlobalConvergence{false,
                             "friction outweighs C(q, v_ref), and is not fed forward; give "
                             "controller.friction.viscous",
                             least.value};
  }
  return GlobalConvergence{
      true,
      fmt::format("friction outweighs C(q, v_ref), by at least {:.2g} N m s/rad at {} (sampled)",
                  least.value, joint),
      least.value};
}

}  // namespace tachless::lyapunov
