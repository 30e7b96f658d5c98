#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "in_process/in_process_loop.h"

/// When K goes to infinity, eq. 9-12 of the paper become eq. 4-5 for the rigid robot M = M_l + J
/// with summed gains. theta_ref approaches q_ref, and K (theta_ref - q_ref) stays finite. With
/// equal filters tau = ID(q, v_ref, a_ref) - (Kp1 + Kp2) e - (Kd1 + Kd2) nu.
namespace tachless::in_process {
namespace {

scenario::Scenario scenario(const std::string& joints, const std::string& law_and_gains) {
  std::ifstream urdf(std::string(TACHLESS_SOURCE_DIR) + "/scenarios/robots/two_link.urdf");
  std::ostringstream urdf_text;
  urdf_text << urdf.rdbuf();
  // The controller does not know the payload, which keeps the error away from zero.
  return scenario::parse_scenario(
      "name: limit\n"
      "robot: {urdf: two_link.urdf, joints: " +
          joints +
          "}\n"
          "plant: {integrator: {accuracy: 1.0e-10}, payload: {mass_kg: 0.5}}\n"
          "reference: {point_to_point: {from_rad: [0, 0], to_rad: [1, -0.5], start_s: 0, "
          "duration_s: 0.4}}\n"
          "controller: {" +
          law_and_gains +
          "}\n"
          "loop: {period_s: 1.0e-4, duration_s: 0.5, command_delay: 0}\n",
      urdf_text.str(), "rigid_limit");
}

std::vector<Vector> link_positions(const scenario::Scenario& s) {
  std::vector<Vector> q;
  run_in_process(s, [&](const TickRecord& record) {
    q.push_back(record.truth.q);
    return true;
  });
  return q;
}

TEST(RigidLimit, IsApproachedWithOrderOneInTheCompliance) {
  const std::vector<Vector> rigid = link_positions(
      scenario("{rigid: {rotor_inertia_kgm2: [0.1, 0.1]}}",
               "law: loria_ortega_rigid, gains: {kp: [500, 50], kd: [120, 12], a: [100, 100], "
               "b: [100, 100]}"));
  double error[3] = {};
  for (int i = 0; i < 3; ++i) {
    const std::string K = std::to_string(100000 << i);
    const std::vector<Vector> flexible = link_positions(scenario(
        "{flexible: {stiffness_Nm_per_rad: [" + K + ", " + K +
            "], "
            "rotor_inertia_kgm2: [0.1, 0.1]}}",
        "law: loria_ortega_flexible, gains: {kp1: [400, 40], kd1: [100, 10], a1: [100, 100], "
        "b1: [100, 100], kp2: [100, 10], kd2: [20, 2], a2: [100, 100], b2: [100, 100]}"));
    ASSERT_EQ(flexible.size(), rigid.size());
    for (std::size_t k = 0; k < rigid.size(); ++k) {
      error[i] = std::max(error[i], (flexible[k] - rigid[k]).cwiseAbs().maxCoeff());
    }
  }
  const double first = std::log2(error[0] / error[1]), second = std::log2(error[1] / error[2]);
  RecordProperty("order", std::to_string(first) + " " + std::to_string(second));
  ASSERT_GT(error[0], 1e-6);  // the error is large enough to shrink
  // The order in 1/K is 1 plus the contribution of the second-order term.
  EXPECT_NEAR(first, 1, 0.1) << error[0] << " " << error[1] << " " << error[2];
  EXPECT_NEAR(second, 1, 0.1);
}

}  // namespace
}  // namespace tachless::in_process
