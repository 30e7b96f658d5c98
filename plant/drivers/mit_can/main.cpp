// The driver of an arm whose drives have the MIT mode, on a CAN bus: docs/drivers/mit_can.md.
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "base/failure.h"
#include "plant/drivers/mit_can/emulated_drives.h"
#include "plant/drivers/mit_can/mit_driver.h"
#include "plant/drivers/mit_can/scan.h"
#include "plant/drivers/program.h"

using namespace tachless;

namespace {

void scan(const std::vector<std::string>& arguments) {
  const bool fd = arguments.size() == 2 && arguments[1] == "--fd";
  if (arguments.empty() || arguments.size() > (fd ? 2U : 1U) || arguments[0].starts_with('-')) {
    throw base::bad_usage("scan: the bus is missing; type: tachless-mit-can scan can0 [--fd]");
  }
  if (mit_can::scan(arguments[0], fd, std::cout) > 0) return;
  throw base::Failure(base::ExitCode::check_said_no,
                      "no drive answers on {}: see power, cable, termination and bit rate",
                      arguments[0]);
}

void serve(const scenario::Scenario& scenario, const std::stop_token& ends) {
  mit_can::EmulatedDrives(scenario).serve(ends);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string name = "tachless-mit-can";
  const plant::DriverProgram program{
      name,
      "Drives an arm whose drives have the MIT mode on a CAN bus",
      "drivers/mit_can.md",
      {{name + " scan can0", "Lists the drives that answer; --fd: on a bus of CAN-FD", scan},
       plant::emulate_verb(name, "arm.yaml", serve)},
      [](const scenario::Scenario& scenario) {
        return std::make_unique<mit_can::MitDriver>(scenario);
      }};
  return plant::driver_main(program, argc, argv);
}
