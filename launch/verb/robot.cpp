#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "diagnostics/file_text.h"
#include "diagnostics/json_text.h"
#include "diagnostics/logging.h"
#include "launch/verb.h"
#include "node/options.h"
#include "report/robot_facts.h"

namespace tachless::launch::verb {
namespace {

using diagnostics::ExitCode;

struct Options {
  std::filesystem::path urdf;
  std::vector<double> position;
  std::filesystem::path plot;
  bool json = false;
};

/// Shows what a scenario needs `robot.check_inertia: warn` for too; `refusal` is then its message.
robot::Model read(const Options& options, std::optional<std::string>& refusal) {
  const std::string source = options.urdf.string();
  const std::string text = diagnostics::given_text(options.urdf);
  try {
    try {
      return robot::model_from_urdf(text, source);
    } catch (const std::invalid_argument& problem) {
      refusal = problem.what();
    }
    robot::UrdfOptions lenient;
    lenient.check_inertia = robot::CheckInertia::warn;
    return robot::model_from_urdf(text, source, lenient);
  } catch (const std::invalid_argument& problem) {
    throw diagnostics::bad_usage(refusal.value_or(problem.what()));
  }
}

ExitCode show(const Options& options) {
  std::optional<std::string> refusal;
  const report::RobotFacts facts(read(options, refusal), options.position);
  if (!options.plot.empty()) {
    report::draw_robot(facts, options.urdf.filename().string(), options.plot);
  }
  std::cout << (options.json ? diagnostics::json_text(to_json(facts), 2) + "\n"
                             : options.urdf.string() + ": " + to_text(facts));
  if (!refusal) return ExitCode::done;
  diagnostics::log_error(*refusal);
  return ExitCode::check_said_no;
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  node::with_installed_scenarios(command.add_option("FILE", options->urdf, "A URDF file"))
      ->required();
  command
      .add_option("--position", options->position,
                  "a,b,... in the order of the joints [rad; m]; default: as near to 0 as their "
                  "ranges allow")
      ->delimiter(',');
  command.add_flag("--json", options->json, "As JSON");
  command.add_option("--plot", options->plot,
                     "An SVG: gravity torque and inertia over each joint's range");
  return [options] { return show(*options); };
}

}  // namespace

extern const Verb robot;
const Verb robot = {
    "robot", "What is read of a URDF: joints, limits, masses; torques and inertia at a position",
    "  tachless robot robot.urdf\n"
    "  tachless robot scenarios/robots/two_link.urdf --position 0.5,-1 --json\n"
    "  tachless robot scenarios/robots/iiwa7.urdf --plot iiwa7.svg",
    declare};

}  // namespace tachless::launch::verb
