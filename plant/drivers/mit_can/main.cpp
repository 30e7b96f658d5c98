// The driver of an arm whose drives have the MIT mode, on a CAN bus: docs/drivers/mit_can.md.
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
#include "plant/drivers/mit_can/emulated_drives.h"
#include "plant/drivers/mit_can/mit_driver.h"
#include "plant/drivers/mit_can/scan.h"
#include "plant/node.h"
#include "session/options.h"

using namespace tachless;

namespace {

int scan(int argc, const char* const* argv) {
  base::start_logging("tachless-mit-can", base::Verbosity::normal);
  try {
    const bool fd = argc == 4 && std::strcmp(argv[3], "--fd") == 0;
    if (argc < 3 || argc > 4 || (argc == 4 && !fd) || argv[2][0] == '-') {
      throw base::bad_usage("scan: the bus is missing; type: tachless-mit-can scan can0 [--fd]");
    }
    const int found = mit_can::scan(argv[2], fd, std::cout);
    if (found > 0) return static_cast<int>(base::ExitCode::done);
    throw base::Failure(base::ExitCode::check_said_no,
                        "no drive answers on {}: see power, cable, termination and bit rate",
                        argv[2]);
  } catch (const std::exception&) {
    return base::told_exception("the command line");
  }
}

/// Emulates drives and arm of a scenario until it is interrupted.
int emulate(int argc, const char* const* argv) {
  base::start_logging("tachless-mit-can", base::Verbosity::normal);
  try {
    if (argc < 3 || argv[2][0] == '-') {
      throw base::bad_usage(
          "emulate: the scenario is missing; type: tachless-mit-can emulate "
          "arm.yaml [KEY=VALUE ...]");
    }
    const scenario::Scenario scenario = scenario::load_scenario(
        session::find_scenario(argv[2]), std::vector<std::string>(argv + 3, argv + argc));
    mit_can::EmulatedDrives drives(scenario);
    const std::atomic<bool>& interrupted = base::catch_interruptions();
    std::jthread serving([&](const std::stop_token& ends) { drives.serve(ends); });
    while (!interrupted) std::this_thread::sleep_for(std::chrono::milliseconds(50));
    return static_cast<int>(base::ExitCode::done);
  } catch (const std::exception&) {
    return base::told_exception("the command line");
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::strcmp(argv[1], "scan") == 0) return scan(argc, argv);
  if (argc > 1 && std::strcmp(argv[1], "emulate") == 0) return emulate(argc, argv);
  return plant::driver_program(argc, argv, [](const scenario::Scenario& scenario) {
    return std::make_unique<mit_can::MitDriver>(scenario);
  });
}
