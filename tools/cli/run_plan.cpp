#include "cli/run.h"

#include <fmt/core.h>
#include <sys/resource.h>

#include <cstdlib>
#include <memory>
#include <set>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "base/logging.h"
#include "base/text.h"
#include "base/this_process.h"
#include "bus/network_check.h"
#include "certify/feasibility.h"
#include "certify/prediction.h"
#include "controller/law_socket.h"
#include "plant/plant_model.h"
#include "reference/make_trajectory.h"
#include "robot/model.h"
#include "scenario/description.h"
#include "session/options.h"

namespace tachless::cli {
namespace {

namespace fs = std::filesystem;

/// Checks that the four programs of each of `runs` can open the files and sockets that they need.
void require_open_files(std::size_t runs) {
  const rlim_t needed = 64 * runs;  // pipes to the programs, sockets, log
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= needed) return;
  throw base::bad_usage(
      "a program may have {} files open here; a run needs {}; type: ulimit -n 1024", limit.rlim_cur,
      needed);
}

void require_fitting_mode(const RunOptions& options, const scenario::Scenario& scenario) {
  const bool lockstep = scenario.loop.mode == scenario::Mode::lockstep;
  if (options.in_process && !lockstep) {
    throw base::bad_usage(
        "{}: --in-process: loop.mode is realtime, and in one process there is no clock to keep; "
        "type --mode lockstep, or leave --in-process out",
        scenario.source);
  }
  if (options.plant_program.empty() && (scenario.plant.dry_run || scenario.plant.zero_torque)) {
    throw scenario.complaint(std::string(plant::key_without_torques(scenario.plant)),
                             "true: the robot is emulated; allowed: with --plant");
  }
}

scenario::Scenario checked_scenario(const RunOptions& options) {
  scenario::Scenario scenario = scenario::load_scenario(options.scenario, options.all_overrides());
  reference::make_trajectory(scenario);
  if (options.law_program.empty()) controller::scenario_law(scenario);
  const robot::Model model = plant::plant_model(scenario);
  plant::initial_state(scenario.plant, scenario.robot.flexible, model);
  plant::make_drive(scenario.plant, scenario.loop, model);
  require_fitting_mode(options, scenario);
  return scenario;
}

/// A channel that robots of both prefixes would use; empty: none. Not of equal ones only: of "ARM"
/// and "ARM_LINK": ARM_LINK_STATE is the link state of the one and the state of the other.
std::string common_channel(const std::string& one, const std::string& other) {
  std::string common;
  messages::for_each_type(messages::Messages(), [&]<class A>(std::type_identity<A> /*type*/) {
    messages::for_each_type(messages::Messages(), [&]<class B>(std::type_identity<B> /*type*/) {
      if (messages::channel<A>(one) == messages::channel<B>(other))
        common = messages::channel<A>(one);
    });
  });
  return common;
}

void require_own_channels(const scenario::Scenario& one, const scenario::Scenario& other) {
  const std::string common = common_channel(one.robot.channel_prefix, other.robot.channel_prefix);
  if (common.empty()) return;
  throw base::bad_usage(
      "{} and {}: robot.name is {} and {}, and so both robots would use the channel {}; write "
      "another robot.name into one of the files (--set sets it for both)",
      one.source, other.source, one.robot.name, other.robot.name, common);
}

std::string friction_text(const scenario::Scenario& scenario) {
  const robot::Model& model = *scenario.model;
  std::string text;
  if (scenario.robot.compensates.friction == 1) return text;
  const auto add = [&](const char* key, const Vector& of_urdf, const char* what) {
    if (of_urdf.isZero(0) || scenario.gives(key)) return;
    text += fmt::format("{}{}", text.empty() ? "" : ", ", what);
  };
  add("plant.drive.viscous_friction_Nms_per_rad", model.damping,
      "viscous friction as the URDF's <dynamics damping>");
  add("plant.drive.coulomb_friction_Nm", model.friction,
      "Coulomb friction as the URDF's <dynamics friction>");
  return text;
}

/// Lowers loop.max_missed of a real robot to the number that its loop tolerates (searched).
void bound_missed(PlannedRun& run) {
  const auto& missed = run.predicted.missed;
  if (!missed || missed->commands >= run.scenario.loop.max_missed) return;
  run.options.overrides.push_back(fmt::format("loop.max_missed={}", missed->commands));
  const std::string announced = run.scenario.controller.announced;  // in no file
  run.scenario = scenario::load_scenario(run.options.scenario, run.options.all_overrides());
  run.scenario.controller.announced = announced;
  run.remarks.push_back(
      {false,
       missed->commands == 0
           ? std::string(
                 "loop.max_missed is 0: the search found no missed command that the loop tolerates")
           : fmt::format("loop.max_missed is {}: the loop tolerates this number of missed commands "
                         "in a row (searched, not proved)",
                         missed->commands)});
}

void judge(PlannedRun& run) {
  const RunOptions& options = run.options;
  const scenario::Scenario& scenario = run.scenario;
  const bool bounds_missed = !options.plant_program.empty() &&
                             scenario.loop.mode == scenario::Mode::realtime &&
                             !scenario.gives("loop.max_missed");
  Screen screen(options.quiet);
  linear::LawAnswers answers = law_answers(run.scenario, options.law_program);
  const bool takes_time = answers || bounds_missed;
  const certify::Prediction& loop = run.predicted = certify::analyse(
      scenario, bounds_missed ? linear::Effort::full : linear::Effort::quick,
      [&](std::string_view what) {
        if (takes_time) screen.show(options.named(what));
      },
      answers);
  answers = {};  // ends the program
  screen.clear();
  const bool unstable = loop.unknown.empty() && !loop.stable;
  if (unstable && !options.force) {
    throw base::bad_usage(certify::refusal(loop, options.scenario.string()));
  }
  const certify::Feasibility feasibility = certify::feasibility(scenario);
  std::vector<Remark>& remarks = run.remarks;
  const bool accepted = options.force && options.quiet;
  remarks = {{!accepted && (unstable || loop.unstable_q.size() > 0), certify::text(loop)}};
  if (bounds_missed) bound_missed(run);
  if (const std::string held = certify::friction_text(loop); !held.empty()) {
    remarks.push_back({false, held});
  }
  if (!loop.not_counted.empty()) remarks.push_back({false, "not counted: " + loop.not_counted});
  if (scenario.robot.compensates.adds_torque()) {
    remarks.push_back({false, fmt::format("robot.compensates: the arm adds {}; a real arm is sent "
                                          "the torque without it; log and certificate have the "
                                          "whole torque",
                                          scenario.robot.compensates.text())});
  }
  if (const std::string friction = friction_text(scenario); !friction.empty()) {
    remarks.push_back({false, friction});
  }
  for (const auto* lines :
       {&scenario.model->warnings, &feasibility.impossible, &feasibility.doubtful}) {
    for (const std::string& line : *lines) remarks.push_back({true, line});
  }
}

}  // namespace

std::string measurement_wanted(const RunOptions& options) {
  if (options.law_program.empty()) return {};
  return std::string(
      controller::law_facts(scenario::load_scenario(options.scenario, options.overrides))
          .measurement);
}

std::vector<std::string> RunOptions::all_overrides() const {
  std::vector<std::string> all = overrides;
  if (!law_program.empty()) {
    all.push_back(fmt::format("controller.law={}", controller::external_law_name));
    if (!measurement.empty()) all.push_back("controller.measurement=" + measurement);
  }
  if (!mode.empty()) all.push_back("loop.mode=" + mode);
  if (!duration_s.empty()) all.push_back("loop.duration_s=" + duration_s);
  if (dry_run) all.emplace_back("plant.dry_run=true");
  return all;
}

controller::MakeLaw make_law(const std::string& law_program) {
  if (law_program.empty()) return controller::scenario_law;
  return [law_program](const scenario::Scenario& scenario) {
    return controller::external_law(scenario, law_program);
  };
}

linear::LawAnswers law_answers(scenario::Scenario& scenario, const std::string& law_program) {
  using controller::LawProgram;
  if (law_program.empty()) return {};
  const auto program = std::make_shared<LawProgram>(scenario, law_program);
  scenario.controller.announced = program->law();
  return [program](double period_s, controller::Gravity gravity, auto measurements,
                   const auto& reference) {
    return program->answers(period_s, gravity, measurements, reference);
  };
}

std::string RunOptions::named(std::string_view line) const {
  return robot.empty() ? std::string(line) : fmt::format("{}: {}", robot, line);
}

report::Visuals PlannedRun::visuals() const {
  const fs::path file = options.scenario.parent_path() / scenario.robot.urdf_path;
  try {
    return report::read_visuals(scenario::read_description(file, scenario.robot.xacro).urdf,
                                file.parent_path());
  } catch (const base::Failure& problem) {
    base::log_warning("the robot is drawn without its visuals: {}", problem.what());
    return {};
  }
}

void PlannedRun::print_remarks() const {
  for (const auto& [warns, line] : remarks) {
    if (warns) {
      base::log_warning(options.named(line));
    } else if (!options.quiet) {
      base::log_info(options.named(line));
    }
  }
}

Progress PlannedRun::progress() const {
  const std::vector<std::string> lengths = robot::joint_labels(*scenario.model).length;
  const std::set<std::string> units(lengths.begin(), lengths.end());
  return {scenario.loop.num_ticks, scenario.loop.period_s,
          base::joined(std::vector<std::string>(units.rbegin(), units.rend())), options.robot};
}

std::vector<PlannedRun> plan_runs(RunOptions options, const std::vector<fs::path>& scenarios) {
  require_open_files(scenarios.size());
  if (options.run_id == 0) options.run_id = session::run_id_at(std::chrono::system_clock::now());
  std::vector<PlannedRun> runs;
  for (const fs::path& path : scenarios) {
    options.scenario = path;
    options.measurement = measurement_wanted(options);
    scenario::Scenario scenario = checked_scenario(options);
    if (scenarios.size() > 1) options.robot = scenario.robot.name;
    for (const PlannedRun& other : runs) require_own_channels(other.scenario, scenario);
    runs.push_back({options, std::move(scenario)});
  }
  for (PlannedRun& run : runs) judge(run);
  return runs;
}

bool prepare_network(const RunOptions& options) {
  static bool isolated = false;  // by an earlier run of this process
  if (isolated) return true;
  const bus::LcmUrl url = session::parse_lcm_url(options.lcm_url);
  const char* variable = std::getenv("TACHLESS_ISOLATE");
  const std::string_view value = variable == nullptr ? "" : variable;
  const bool wanted = options.isolate || !(value.empty() || value == "0");
  if (!wanted) {
    const auto problem = bus::check_network(url);
    if (!problem) return false;
    base::log_warning(
        "this host has no usable multicast ({}): the run is isolated in a private network; to "
        "change this, type: {}",
        problem->what, problem->remedy);
  }
  try {
    base::enter_private_network();
  } catch (const std::system_error& error) {
    throw base::bad_usage("cannot isolate the run: {}", error.what());
  }
  isolated = true;
  return true;
}

}  // namespace tachless::cli
