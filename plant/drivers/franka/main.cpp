// The driver of a Franka arm by libfranka: docs/drivers/franka.md.
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "base/failure.h"
#include "plant/drivers/franka/emulated_arm.h"
#include "plant/drivers/franka/franka_driver.h"
#include "plant/drivers/program.h"

using namespace tachless;

namespace {

void print_urdf(const std::vector<std::string>& arguments) {
  if (arguments.size() != 1) {
    throw base::bad_usage("urdf: the address is missing; type: tachless-franka urdf 172.16.0.2");
  }
  std::cout << fci::told_urdf(arguments[0]) << std::flush;
}

void serve(const scenario::Scenario& scenario, const std::stop_token& ends) {
  fci::EmulatedArm(scenario, fci::Pace::as_the_arm).serve(ends);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string name = "tachless-franka";
  const plant::DriverProgram program{
      name,
      "Drives a Franka arm by libfranka",
      "drivers/franka.md",
      {{name + " urdf 172.16.0.2", "Prints the model that the arm tells, as a URDF", print_urdf},
       plant::emulate_verb(name, "fr3.yaml", serve)},
      [](const scenario::Scenario& scenario) {
        return std::make_unique<fci::FrankaDriver>(scenario);
      }};
  return plant::driver_main(program, argc, argv);
}
