#pragma once

#include <functional>
#include <stop_token>
#include <string>
#include <vector>

#include "plant/node.h"
#include "scenario/scenario.h"

namespace tachless::plant {

/// A verb of a driver's program, such as `scan`.
struct DriverVerb {
  std::string example;  ///< a whole line to type: "tachless-mit-can scan can0"
  std::string meaning;  ///< one line for --help
  /// Runs the verb with the arguments behind its name.
  /// @throw base::Failure if the verb fails; its text is one line for the user
  std::function<void(const std::vector<std::string>& arguments)> run;
};

/// A driver's program. The name of a verb is the second word of its example.
struct DriverProgram {
  std::string name;     ///< "tachless-mit-can"
  std::string purpose;  ///< first line of --help
  std::string page;     ///< path of the page in docs/: "drivers/mit_can.md"
  std::vector<DriverVerb> verbs;
  MakeDriver make;
};

/// Implements `main` of a driver's program: a verb, --help, or else `driver_program`.
int driver_main(const DriverProgram& program, int argc, const char* const* argv);

/// Serves an emulated robot of a scenario until it is requested to end.
using ServeRobot = std::function<void(const scenario::Scenario&, const std::stop_token&)>;

/// Returns the verb `emulate`, which calls `serve` in a thread of its own until the program is
/// interrupted.
DriverVerb emulate_verb(const std::string& program, const std::string& scenario, ServeRobot serve);

}  // namespace tachless::plant
