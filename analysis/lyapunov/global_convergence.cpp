#include "lyapunov/global_convergence.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <string_view>
#include <vector>

#include "controller/laws.h"
#include "controller/registry.h"
#include "lyapunov/law_loop.h"
#include "numerics/decompositions.h"
#include "numerics/postures.h"
#include "reference/make_trajectory.h"

namespace tachless::lyapunov {
namespace {

using Eigen::VectorXd;
using namespace controller::law;

/// Returns whether the reference ends at rest. Sums of sines do not.
bool comes_to_rest(const scenario::Scenario& scenario) {
  return reference::composition_of(scenario.reference).sines.empty();
}

/// Least eigenvalue of D + sym C(q, v_ref), and the joint in which its eigenvector is largest.
struct LeastDamping {
  double value = infinity;
  Eigen::Index joint = 0;
};

/// Lowers `least` to the least eigenvalue of D + sym C(q, v_ref) over the references, if it is
/// less.
void lower(LeastDamping& least, const numerics::Inertia& at, const VectorXd& D,
           const std::vector<messages::ReferencePoint>& references) {
  std::vector<Eigen::MatrixXd> C;
  for (const Eigen::MatrixXd& each : at.C) C.push_back(symmetric_part(each));
  for (const messages::ReferencePoint& r : references) {
    Eigen::MatrixXd sum = D.asDiagonal();
    for (Eigen::Index j = 0; j < D.size(); ++j) sum += r.v_ref[j] * C[static_cast<std::size_t>(j)];
    // A factorisation shows faster than the eigenvalues that none is below the least so far.
    Eigen::MatrixXd above = sum;
    above.diagonal().array() -= least.value;
    if (std::isfinite(least.value) && above.llt().info() == Eigen::Success) continue;
    const auto [values, vectors] = numerics::symmetric_eigen(sum);
    if (values[0] >= least.value) continue;
    least.value = values[0];
    vectors.col(0).cwiseAbs().maxCoeff(&least.joint);
  }
}

/// Looks at the instants of the motion with the robot on it, and at postures anywhere, each with
/// all velocities of the motion. The numbers take some tenths of a second for seven joints. The
/// result is sampled, and says so.
LeastDamping least_damping(const scenario::Scenario& scenario, const VectorXd& D) {
  constexpr int instants = 65, postures = 256;
  const robot::Model model = error_model(scenario);
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  std::vector<messages::ReferencePoint> references;
  for (const double t_s : reference::Motion(scenario, trajectory).closely(instants)) {
    references.push_back(trajectory.at(t_s));
  }
  LeastDamping least;
  for (const messages::ReferencePoint& r : references) {
    lower(least, numerics::inertia_at(model, r.q_ref), D, {r});
  }
  for (int k = 1; k <= postures; ++k) {
    lower(least, numerics::inertia_at(model, numerics::spread_posture(model, k)), D, references);
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
