// The driver of a Franka arm by libfranka: docs/drivers/franka.md.
#include <atomic>
#include <chrono>
#include <cstring>
#include <iostream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "base/failure.h"
#include "base/logging.h"
#include "base/this_process.h"
#include "plant/drivers/franka/emulated_arm.h"
#include "plant/drivers/franka/franka_driver.h"
#include "plant/node.h"
#include "session/options.h"

using namespace tachless;

namespace {

/// Prints the model that the arm tells.
void print_urdf(int argc, const char* const* argv) {
  if (argc != 3) {
    throw base::bad_usage("urdf: the address is missing; type: tachless-franka urdf 172.16.0.2");
  }
  std::cout << fci::told_urdf(argv[2]) << std::flush;
}

/// Emulates the arm of a scenario until it is interrupted.
void emulate(int argc, const char* const* argv) {
  if (argc < 3) {
    throw base::bad_usage(
        "emulate: the scenario is missing; type: tachless-franka emulate fr3.yaml [KEY=VALUE ...]");
  }
  const scenario::Scenario scenario = scenario::load_scenario(
      session::find_scenario(argv[2]), std::vector<std::string>(argv + 3, argv + argc));
  fci::EmulatedArm arm(scenario, fci::Pace::as_the_arm);
  const std::atomic<bool>& interrupted = base::catch_interruptions();
  std::jthread serving([&](const std::stop_token& ends) { arm.serve(ends); });
  while (!interrupted) std::this_thread::sleep_for(std::chrono::milliseconds(50));
}

int verb(void (*run)(int, const char* const*), int argc, const char* const* argv) {
  base::start_logging("tachless-franka", base::Verbosity::normal);
  try {
    run(argc, argv);
    return static_cast<int>(base::ExitCode::done);
  } catch (const std::exception&) {
    return base::told_exception("the command line");
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::strcmp(argv[1], "urdf") == 0) return verb(print_urdf, argc, argv);
  if (argc > 1 && std::strcmp(argv[1], "emulate") == 0) return verb(emulate, argc, argv);
  return plant::driver_program(argc, argv, [](const scenario::Scenario& scenario) {
    return std::make_unique<fci::FrankaDriver>(scenario);
  });
}
