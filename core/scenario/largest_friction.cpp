#include "scenario/largest_friction.h"

#include "robot/gravity_bound.h"

namespace tachless::scenario {

Vector largest_friction(const Scenario& scenario) {
  const plant::DriveSpec& drive = scenario.plant.drive;
  Vector largest = drive.static_friction_Nm.value_or(drive.coulomb_friction_Nm);
  if (drive.friction_rise_Nm.size() > 0) largest += drive.friction_rise_Nm.cwiseMax(0);
  if (!drive.load_friction.isZero(0)) {
    const robot::Model model = with_payload(scenario, *scenario.model);
    largest += drive.load_friction.cwiseProduct(robot::gravity_bound(model));
  }
  return largest;
}

}  // namespace tachless::scenario
