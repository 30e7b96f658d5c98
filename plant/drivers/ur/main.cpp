// The driver of an arm of Universal Robots by the maker's client library: docs/drivers/ur.md.
#include <memory>

#include <ur_client_library/log.h>

#include "plant/drivers/program.h"
#include "plant/drivers/ur/emulated_controller.h"
#include "plant/drivers/ur/ur_driver.h"

using namespace tachless;

namespace {

void serve(const scenario::Scenario& scenario, const std::stop_token& ends) {
  ur::EmulatedController(scenario).serve(ends);
}

}  // namespace

int main(int argc, char** argv) {
  urcl::setLogLevel(urcl::LogLevel::WARN);
  const plant::DriverProgram program{
      "tachless-ur",
      "Drives an arm of Universal Robots by the maker's library",
      "drivers/ur.md",
      {plant::emulate_verb("tachless-ur", "arm.yaml", serve)},
      [](const scenario::Scenario& scenario) { return std::make_unique<ur::UrDriver>(scenario); }};
  return plant::driver_main(program, argc, argv);
}
