#pragma once

#include <string>
#include <vector>

namespace tachless::support {

/// Returns every disturbance of docs/plant.md for a two-link arm, at once and within 0.2 s.
/// @param friction of the kind that holds joints, which Simbody's mechanics do not support
inline std::vector<std::string> rough_plant(bool friction) {
  std::vector<std::string> all = {
      "loop.command_delay=3",
      "plant.encoder={resolution_bits: [16, 14], noise_std_rad: 1.0e-5, latency_ticks: 2, "
      "eccentricity_rad: 1.0e-3, eccentricity_phase_rad: 1}",
      "plant.drive.current_loop_hz=[300, 200]",
      "plant.drive.torque_scale=[1.05, 0.97]",
      "plant.drive.torque_offset_Nm=[0.5, -0.2]",
      "plant.drive.command_age_jitter_ticks=2",
      "plant.drive.torque_limit_Nm=[150, 40]",
      "plant.drive.torque_rate_limit_Nm_per_s=[1.0e+4, 5.0e+3]",
      "plant.payload={mass_kg: 0.5, inertia_kgm2: [0.01, 0, 0, 0.02, 0, 0.02], center_of_mass_m: "
      "[0.1, 0, 0]}",
      "plant.disturbances=[{joint: elbow, torque_Nm: 3, start_s: 0.02, end_s: 0.0305}, "
      "{link: tip, force_N: [5, 0, -5], shape: pulse, start_s: 0.06, end_s: 0.08}, "
      "{joint: shoulder, torque_Nm: 2, shape: sinusoid, frequency_hz: 30}]",
      "controller.urdf=" TACHLESS_SOURCE_DIR "/scenarios/robots/two_link_payload.urdf"};
  if (friction) {
    all.insert(all.end(), {"plant.drive.coulomb_friction_Nm=[1, 0.3]",
                           "plant.drive.static_friction_Nm=[1.5, 0.4]",
                           "plant.drive.viscous_friction_Nms_per_rad=0.1"});
  }
  return all;
}

}  // namespace tachless::support
