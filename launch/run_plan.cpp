#include "launch/run_plan.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "bus/network_check.h"
#include "controller/law_socket.h"
#include "diagnostics/file_text.h"
#include "diagnostics/logging.h"
#include "node/options.h"
#include "plant/plant_model.h"
#include "process/installation.h"
#include "process/isolate.h"
#include "reference/make_trajectory.h"
#include "robot/joint_labels.h"

namespace tachless::launch {
namespace {

namespace fs = std::filesystem;

constexpr std::array our_files = {"lcmlog", "summary.json", "tracking.svg", "report.html"};
constexpr std::array roles = {loop::Role::logger, loop::Role::controller, loop::Role::reference,
                              loop::Role::plant};
// Processes of one launcher find each other at once or never.
constexpr const char* rendezvous_s = "10";
constexpr double many_integrator_steps = 100;
// From a controller's death until another one has taken its place, on a busy machine.
constexpr double takeover_s = 2;

void require_restartable(const RunOptions& options, const experiment::Scenario& scenario) {
  if (options.restart.empty()) return;
  if (scenario.loop.mode != experiment::Mode::lockstep) {
    throw diagnostics::bad_usage(
        "{}: --restart {}: a realtime run does not wait for another controller: the robot is "
        "stopped; leave --restart out, or take --mode lockstep",
        scenario.source, options.restart);
  }
  if (scenario.loop.give_up_s < takeover_s) {
    throw diagnostics::bad_usage(
        "{}: --restart {}: loop.give_up_s is {:g} s; allowed: {:g} s and more, for so long may it "
        "take until another one has taken its place",
        scenario.source, options.restart, scenario.loop.give_up_s, takeover_s);
  }
}

void require_no_clock(const RunOptions& options, const experiment::Scenario& scenario) {
  if (!options.in_process || scenario.loop.mode == experiment::Mode::lockstep) return;
  throw diagnostics::bad_usage(
      "{}: --in-process: loop.mode is realtime, and in one process there is no clock to keep; type "
      "--mode lockstep, or leave --in-process out",
      scenario.source);
}

/// A channel that robots of both prefixes would use; empty: none. Besides of equal ones, of "ARM"
/// and "ARM_LINK": ARM_LINK_STATE is the link state of the one and the state of the other.
std::string common_channel(const std::string& one, const std::string& other) {
  std::string common;
  loop::for_each_type(loop::Messages(), [&]<class A>(std::type_identity<A> /*type*/) {
    loop::for_each_type(loop::Messages(), [&]<class B>(std::type_identity<B> /*type*/) {
      if (loop::channel<A>(one) == loop::channel<B>(other)) common = loop::channel<A>(one);
    });
  });
  return common;
}

bool isolation_wanted(const RunOptions& options) {
  const char* variable = std::getenv("TACHLESS_ISOLATE");
  const std::string value = variable == nullptr ? "" : variable;
  return options.isolate || !(value.empty() || value == "0");
}

}  // namespace

std::vector<std::string> RunOptions::all_overrides() const {
  std::vector<std::string> all = overrides;
  if (!law_program.empty()) {
    all.push_back(fmt::format("controller.law={}", experiment::external_law));
    if (!measurement.empty()) all.push_back("controller.measurement=" + measurement);
  }
  if (!mode.empty()) all.push_back("loop.mode=" + mode);
  if (!duration_s.empty()) all.push_back("loop.duration_s=" + duration_s);
  return all;
}

controller::MakeLaw RunOptions::make_law() const {
  if (law_program.empty()) return controller::scenario_law;
  return [program = law_program](const experiment::Scenario& of) {
    return controller::external_law(of, program);
  };
}

std::string RunOptions::named(std::string_view line) const {
  return robot.empty() ? std::string(line) : fmt::format("{}: {}", robot, line);
}

std::string measurement_wanted(const RunOptions& options) {
  if (options.law_program.empty()) return {};
  const experiment::Scenario scenario =
      experiment::load_scenario(options.scenario, options.overrides);
  const std::string& law = scenario.controller.law;
  if (law == experiment::external_law) return {};
  try {
    return std::string(controller::law_facts(law).measurement);
  } catch (const std::invalid_argument& problem) {
    throw scenario.complaint("controller.law", problem.what());
  }
}

fs::path RunOptions::directory(const experiment::Scenario& checked) const {
  if (robot.empty()) return out.empty() ? fs::path("out") / checked.name : out;
  return (out.empty() ? fs::path("out") : out) / robot;
}

void require_open_files(std::size_t runs) {
  const rlim_t needed = 64 * runs;  // pipes to the programs, sockets, log
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= needed) return;
  throw diagnostics::bad_usage(
      "a program may have {} files open here; a run needs {}; type: ulimit -n 1024", limit.rlim_cur,
      needed);
}

void require_own_channels(const experiment::Scenario& one, const experiment::Scenario& other) {
  const std::string common = common_channel(one.robot.channel_prefix, other.robot.channel_prefix);
  if (common.empty()) return;
  throw diagnostics::bad_usage(
      "{} and {}: robot.name is {} and {}, and so both robots would use the channel {}; write "
      "another robot.name into one of the files (--set sets it for both)",
      one.source, other.source, one.robot.name, other.robot.name, common);
}

experiment::Scenario checked_scenario(const RunOptions& options) {
  experiment::Scenario scenario =
      experiment::load_scenario(options.scenario, options.all_overrides());
  reference::make_trajectory(scenario);
  if (options.law_program.empty()) controller::scenario_law(scenario);
  const robot::Model model = plant::plant_model(scenario);
  plant::initial_state(scenario, model);
  plant::make_drive(scenario, model);
  require_restartable(options, scenario);
  require_no_clock(options, scenario);
  const double steps = plant::integrator_steps_per_tick(scenario, model);
  if (steps > many_integrator_steps && !options.quiet) {
    const auto joint = plant::stiff_friction(scenario, model, many_integrator_steps);
    diagnostics::log_warning(
        "{}: the joints are stiff for this period: about {} integrator steps a tick; expect a slow "
        "run{}",
        scenario.source, std::llround(steps),
        joint ? fmt::format("; the viscous friction of {} is out of proportion to its inertia: "
                            "plant.drive.viscous_friction_Nms_per_rad gives it another",
                            robot::joint_labels(model).joint(*joint))
              : "");
  }
  return scenario;
}

bool prepare_network(const RunOptions& options) {
  const bus::LcmUrl url = node::parse_lcm_url(options.lcm_url);
  if (url.is_tcp()) {
    if (isolation_wanted(options)) {
      throw diagnostics::bad_usage(
          "--isolate: the server of {} cannot be reached from a private network; leave --isolate "
          "(TACHLESS_ISOLATE) out",
          url.text());
    }
    const auto problem = bus::check_network(url);
    if (problem) {
      throw diagnostics::bad_usage("{}; start it with: {}", problem->what, problem->remedy);
    }
    return false;
  }
  if (!isolation_wanted(options)) {
    const auto problem = bus::check_network(url);
    if (!problem) return false;
    diagnostics::log_warning(
        "this host has no usable multicast ({}): the run is isolated in a private network; to mend "
        "it, type: {}",
        problem->what, problem->remedy);
  }
  try {
    process::enter_private_network();
  } catch (const std::system_error& error) {
    throw diagnostics::bad_usage("cannot isolate the run: {}", error.what());
  }
  return true;
}

RunDirectory::RunDirectory(fs::path path) : path_(std::move(path)) {
  std::error_code error;
  fs::create_directories(path_, error);
  if (error || !fs::is_directory(path_)) {
    refuse("cannot be made a directory" + (error ? ": " + error.message() : ""));
  }
  lock_ = process::FileDescriptor(::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (lock_.get() < 0) refuse(fmt::format("cannot be opened: {}", std::strerror(errno)));
  if (flock(lock_.get(), LOCK_EX | LOCK_NB) != 0) refuse("another run is writing there");
  if (access(path_.c_str(), W_OK | X_OK) != 0) refuse("is not writable");
  // What a launcher that was killed has left aside: either its run has begun, or its log is empty.
  look();
  if (!std::exchange(begun_, false)) restore();
  for (const char* file : our_files) {
    if (fs::exists(path_ / file)) fs::rename(path_ / file, aside(file), error);
    if (!error) continue;
    restore();
    refuse(fmt::format("{} there cannot be replaced: {}", file, error.message()));
  }
  for (const loop::Role role : roles) fs::remove(statistics_path(role), error);
}

RunDirectory::~RunDirectory() {
  look();
  if (!begun_) restore();
}

fs::path RunDirectory::aside(const std::string& file) const { return path_ / (".earlier-" + file); }

void RunDirectory::look() {
  if (begun_) return;
  std::error_code ignored;
  const auto size = fs::file_size(path_ / "lcmlog", ignored);
  if (ignored || size == 0) return;
  begun_ = true;
  fs::rename(aside("lcmlog"), path_ / "lcmlog.previous", ignored);
  for (const char* file : our_files) fs::remove(aside(file), ignored);
}

void RunDirectory::restore() {
  std::error_code ignored;
  if (fs::is_empty(path_ / "lcmlog", ignored)) fs::remove(path_ / "lcmlog", ignored);
  for (const char* file : our_files) fs::rename(aside(file), path_ / file, ignored);
}

fs::path RunDirectory::statistics_path(loop::Role role) const {
  return path_ / fmt::format(".{}.json", loop::name(role));
}

std::vector<node::Statistics> RunDirectory::take_statistics() const {
  std::vector<node::Statistics> all;
  for (const loop::Role role : roles) {
    const fs::path path = statistics_path(role);
    try {
      all.push_back(node::statistics_from_json(diagnostics::file_text(path).value_or("")));
    } catch (const std::invalid_argument&) {  // it was killed and left none, or half of it
    }
    std::error_code ignored;
    fs::remove(path, ignored);
  }
  return all;
}

std::vector<fs::path> RunDirectory::files() const {
  std::vector<fs::path> found;
  for (const char* file : our_files) {
    if (fs::exists(path_ / file)) found.push_back(path_ / file);
  }
  return found;
}

void RunDirectory::refuse(const std::string& why) const {
  throw diagnostics::bad_usage("--out {}: {}; choose another directory", path_.string(), why);
}

std::vector<std::string> command_of(const std::string& program, const RunOptions& options) {
  std::vector<std::string> command = {(process::program_directory() / program).string(),
                                      options.scenario.string(), "--lcm-url", options.lcm_url};
  if (!options.key_file.empty()) command.insert(command.end(), {"--key-file", options.key_file});
  for (const std::string& value : options.all_overrides()) {
    command.insert(command.end(), {"--set", value});
  }
  return command;
}

std::vector<Process> run_processes(const RunOptions& options, const Placement& placement,
                                   const RunDirectory& out) {
  const std::string log = (out / "lcmlog").string();
  std::vector<Process> all;
  for (const loop::Role role : roles) {
    std::vector<std::string> command = command_of(node::program_name(role), options);
    command.insert(command.end(),
                   {options.verbose ? "--verbose" : "--quiet", "--mark-levels", "--wait-s",
                    rendezvous_s, "--stats", out.statistics_path(role).string()});
    if (role == loop::Role::plant) {
      command.insert(command.end(), {"--run-id", std::to_string(options.run_id)});
    }
    if (role == loop::Role::controller && !options.law_program.empty()) {
      command =
          controller::shell_command(options.law_program, {command.begin() + 1, command.end()});
    }
    if (role == loop::Role::logger) command.insert(command.end(), {"--out-log", log});
    if (placement.spin && role != loop::Role::logger) command.emplace_back("--spin");
    Process process{std::string(loop::name(role)), std::move(command), {}, placement.cpus_of(role)};
    if (process.name == options.restart) {
      process.restart = process.command;
      process.restart.insert(process.restart.end(), {"--resume", log});
    }
    all.push_back(std::move(process));
  }
  return all;
}

}  // namespace tachless::launch
