#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <system_error>
#include <thread>

#include "bus/authenticated.h"
#include "bus/network_check.h"
#include "bus/udp_transport.h"
#include "bus/wire.h"
#include "controller/registry.h"
#include "diagnostics/logging.h"
#include "experiment/scenario.h"
#include "launch/progress.h"
#include "launch/supervise.h"
#include "launch/verb.h"
#include "node/key_file.h"
#include "node/options.h"
#include "node/process_options.h"
#include "plant/plant_model.h"
#include "plant/realtime_loop.h"
#include "process/interruption.h"
#include "process/isolate.h"
#include "process/side_process.h"
#include "reference/make_trajectory.h"
#include "report/figure.h"
#include "report/gnuplot.h"
#include "report/joint_units.h"
#include "report/log_tracking.h"
#include "report/report.h"
#include "report/summary.h"
#include "viewer/visualizer.h"

namespace tachless::launch::verb {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::array our_files = {"lcmlog", "summary.json", "tracking.svg", "report.html"};
constexpr std::array roles = {loop::Role::logger, loop::Role::controller, loop::Role::reference,
                              loop::Role::plant};
// Processes of one launcher meet at once or never.
constexpr const char* rendezvous_s = "10";
constexpr double many_integrator_steps = 100;
// From a controller's death until another one has taken its place, on a busy machine.
constexpr double succession_s = 2;

struct Options {
  fs::path scenario;
  fs::path out;
  std::int64_t run_id = 0;
  std::vector<std::string> overrides;
  std::string mode;
  std::string duration_s;
  std::string lcm_url = node::default_lcm_url;
  std::string key_file;
  std::string restart;
  bool isolate = false;
  bool quiet = false;
  bool json = false;
  bool visualize = false;

  [[nodiscard]] std::vector<std::string> all_overrides() const {
    std::vector<std::string> all = overrides;
    if (!mode.empty()) all.push_back("loop.mode=" + mode);
    if (!duration_s.empty()) all.push_back("loop.duration_s=" + duration_s);
    return all;
  }
};

/// Everything that a process would refuse later is refused here, before any is started.
robot::Model validate(const experiment::Scenario& scenario) {
  reference::make_trajectory(scenario);
  controller::scenario_law(scenario);
  robot::Model model = plant::plant_model(scenario);
  plant::initial_state(scenario, model);
  plant::make_drive(scenario, model);
  return model;
}

bool isolation_wanted(const Options& options) {
  const char* variable = std::getenv("TACHLESS_ISOLATE");
  const std::string value = variable == nullptr ? "" : variable;
  return options.isolate || !(value.empty() || value == "0");
}

void isolate() {
  try {
    process::enter_private_network();
  } catch (const std::system_error& error) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               std::string("cannot isolate the run: ") + error.what());
  }
}

/// Returns whether the run is isolated.
bool prepare_network(const Options& options) {
  const bus::LcmUrl url = node::parse_lcm_url(options.lcm_url);
  if (isolation_wanted(options)) {
    isolate();
    return true;
  }
  if (const auto problem = bus::check_network(url)) {
    diagnostics::log_warning(
        "this host has no usable multicast (" + problem->what +
        "): the run is isolated in a private network; to mend it, type: " + problem->remedy);
    isolate();
    return true;
  }
  return false;
}

/// The run's directory, empty of our files and held against a second run until destruction.
class Directory {
 public:
  explicit Directory(fs::path path) : path_(std::move(path)) {
    std::error_code error;
    fs::create_directories(path_, error);
    if (error || !fs::is_directory(path_)) {
      refuse("cannot be made a directory" + (error ? ": " + error.message() : ""));
    }
    fd_ = ::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd_ < 0) refuse(std::string("cannot be opened: ") + std::strerror(errno));
    if (flock(fd_, LOCK_EX | LOCK_NB) != 0) refuse("another run is writing there");
    if (access(path_.c_str(), W_OK | X_OK) != 0) refuse("is not writable");
    for (const char* file : our_files) {
      if (!fs::remove(path_ / file, error) && error) {
        refuse(std::string(file) + " there cannot be replaced: " + error.message());
      }
    }
    for (const loop::Role role : roles) fs::remove(counters(role), error);
  }
  Directory(const Directory&) = delete;
  Directory& operator=(const Directory&) = delete;
  ~Directory() {
    if (fd_ >= 0) ::close(fd_);
  }

  [[nodiscard]] const fs::path& path() const { return path_; }
  [[nodiscard]] fs::path operator/(const std::string& file) const { return path_ / file; }

  /// Where a process leaves its counters, until they are in the summary.
  [[nodiscard]] fs::path counters(loop::Role role) const {
    return path_ / ("." + std::string(loop::name(role)) + ".json");
  }

 private:
  [[noreturn]] void refuse(const std::string& why) {
    if (fd_ >= 0) ::close(fd_);
    throw diagnostics::Failure(
        diagnostics::ExitCode::bad_usage,
        "--out " + path_.string() + ": " + why + "; choose another directory");
  }

  fs::path path_;
  int fd_ = -1;
};

/// Program and arguments that say which experiment on which bus.
std::vector<std::string> command_of(const std::string& program, const Options& options) {
  const fs::path programs = fs::read_symlink("/proc/self/exe").parent_path();
  std::vector<std::string> command = {(programs / program).string(), options.scenario.string(),
                                      "--lcm-url", options.lcm_url};
  if (!options.key_file.empty()) command.insert(command.end(), {"--key-file", options.key_file});
  for (const std::string& value : options.all_overrides()) {
    command.insert(command.end(), {"--set", value});
  }
  return command;
}

std::vector<Process> processes(const Options& options, const Directory& out) {
  std::vector<Process> all;
  for (const loop::Role role : roles) {
    std::vector<std::string> command = command_of(node::program_name(role), options);
    command.insert(command.end(),
                   {"--quiet", "--wait-s", rendezvous_s, "--stats", out.counters(role).string()});
    if (role == loop::Role::plant) {
      command.insert(command.end(), {"--run-id", std::to_string(options.run_id)});
    }
    if (role == loop::Role::logger) {
      command.insert(command.end(), {"--out-log", (out / "lcmlog").string()});
    }
    Process process{std::string(loop::name(role)), std::move(command), {}};
    if (process.name == options.restart) {
      process.restart = process.command;
      process.restart.insert(process.restart.end(), {"--resume", (out / "lcmlog").string()});
    }
    all.push_back(std::move(process));
  }
  return all;
}

void require_restartable(const Options& options, const experiment::Scenario& scenario) {
  if (options.restart.empty()) return;
  if (scenario.loop.mode != experiment::Mode::lockstep) {
    throw diagnostics::Failure(
        diagnostics::ExitCode::bad_usage,
        "--restart " + options.restart +
            ": a realtime run does not wait for another controller: the robot is "
            "stopped; leave --restart out, or take --mode lockstep");
  }
  if (scenario.loop.give_up_s < succession_s) {
    char text[160];
    std::snprintf(
        text, sizeof text,
        "--restart %s: loop.give_up_s is %g s; allowed: %g s and more, for so long may it "
        "take until another one has taken its place",
        options.restart.c_str(), scenario.loop.give_up_s, succession_s);
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage, text);
  }
}

/// Reads the controller's heartbeats. Only listens.
class Heartbeats {
 public:
  Heartbeats(const std::string& lcm_url, const std::optional<bus::Key>& key,
             const experiment::Scenario& scenario, std::int64_t run)
      : transport_(lcm_url),
        codec_({scenario.num_joints, scenario.robot.flexible ? scenario.num_joints : 0, 0}),
        run_(run) {
    if (key) authenticated_.emplace(transport_, *key);
    transport_.subscribe(loop::channel<loop::Participant>(scenario.robot.channel_prefix));
  }

  void read_into(Progress& progress) {
    bus::Transport& heard =
        authenticated_ ? static_cast<bus::Transport&>(*authenticated_) : transport_;
    while (const auto datagram = heard.receive(loop::Clock::time_point{})) {
      loop::Stamp stamp;
      loop::Participant participant;
      if (codec_.decode(datagram->payload, stamp, participant) == bus::Rejection::none &&
          stamp.run == run_ && participant.role == loop::Role::controller) {
        progress.note(stamp.tick, participant.error_norm, Clock::now());
      }
    }
  }

 private:
  bus::UdpTransport transport_;
  std::optional<bus::Authenticated> authenticated_;
  bus::Codec<loop::Participant> codec_;
  std::int64_t run_;
};

/// The line on stderr that says how far the run is, and other lines between.
class Screen {
 public:
  explicit Screen(bool quiet) : quiet_(quiet) {}

  void show(const Progress& progress) {
    const Clock::time_point now = Clock::now();
    if (quiet_ || now < next_) return;
    if (terminal_) {
      std::cerr << "\r\033[K" << progress.line() << std::flush;
      shown_ = true;
      next_ = now + std::chrono::milliseconds(100);
    } else {
      if (next_ != Clock::time_point{}) std::cerr << progress.line() + "\n" << std::flush;
      next_ = now + std::chrono::seconds(5);
    }
  }

  void clear() {
    if (std::exchange(shown_, false)) std::cerr << "\r\033[K" << std::flush;
  }

  void pass_on(std::string_view name, std::string_view line) {
    if (line.ends_with(": interrupted")) return;  // said once, by the launcher
    clear();
    const std::string prefix = line.starts_with("tachless-") ? "" : std::string(name) + ": ";
    std::cerr << prefix + std::string(line) + "\n" << std::flush;
  }

 private:
  bool quiet_;
  bool terminal_ = isatty(STDERR_FILENO) == 1;
  bool shown_ = false;
  Clock::time_point next_{};
};

/// Simbody's 3D window beside the run. Its end is said, and ends nothing.
class Window {
 public:
  /// @throw diagnostics::Failure(bad_usage) when none can be opened
  Window(const Options& options, bool isolated, Screen& screen) : screen_(screen) {
    std::vector<std::string> command = command_of("tachless-visualizer", options);
    command.insert(command.end(), {"--run-id", std::to_string(options.run_id)});
    constexpr std::string_view itself = "tachless-visualizer: ";
    try {
      program_.emplace("tachless-visualizer", command, viewer::window_is_open,
                       std::chrono::seconds(30),
                       [&](std::string_view line) { screen_.pass_on("visualizer", line); });
    } catch (const diagnostics::Failure& failure) {
      std::string why = failure.what();
      if (why.starts_with(itself)) why.erase(0, itself.size());
      throw diagnostics::Failure(
          failure.code(),
          "--visualize: " + why + "; or leave out --visualize" +
              (isolated ? " (this run is isolated: it reaches no display over the network)" : ""));
    }
  }

  void attend() {
    if (!program_->running()) return;
    program_->attend();
    if (program_->running()) return;
    const std::string& trouble = program_->trouble();
    screen_.clear();
    diagnostics::log_warning("the window " +
                             (trouble.empty() ? "was closed" : "is gone: " + trouble) +
                             "; the run goes on");
  }

  /// The run is over: what is left to show will be shown.
  void run_is_over(bool interrupted) { interrupted ? program_->stop() : program_->signal(SIGUSR1); }

  /// Waits until the window has shown everything, is closed, or somebody is tired of it.
  void finish(bool quiet) {
    const std::atomic<bool>& interrupted = process::catch_interruptions();
    program_->attend();
    if (program_->running() && !quiet) {
      diagnostics::log_info(
          "the window shows the run to its end, at the simulated pace; Ctrl-C closes it");
    }
    while (program_->running() && !interrupted) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      program_->attend();
    }
    program_->stop();
  }

 private:
  Screen& screen_;
  std::optional<process::SideProcess> program_;
};

std::vector<nlohmann::json> take_counters(const Directory& out) {
  std::vector<nlohmann::json> counters;
  for (const loop::Role role : roles) {
    const fs::path path = out.counters(role);
    std::ifstream file(path);
    nlohmann::json counter = nlohmann::json::parse(file, nullptr, false);
    if (counter.is_object()) counters.push_back(std::move(counter));
    std::error_code ignored;
    fs::remove(path, ignored);
  }
  return counters;
}

std::optional<std::string> fault_of(const Supervision& supervision) {
  if (supervision.interrupted) return "interrupted";
  if (supervision.culprit) return describe(supervision.ends[*supervision.culprit]);
  return {};
}

diagnostics::ExitCode run_scenario(Options options) {
  const experiment::Scenario scenario =
      experiment::load_scenario(options.scenario, options.all_overrides());
  const robot::Model model = validate(scenario);
  require_restartable(options, scenario);
  const double steps = plant::integrator_steps_per_tick(scenario, model);
  if (steps > many_integrator_steps && !options.quiet) {
    diagnostics::log_warning("the joints are stiff for this period: about " +
                             std::to_string(std::llround(steps)) +
                             " integrator steps a tick; expect a slow run");
  }
  std::optional<bus::Key> key;
  if (!options.key_file.empty()) key = node::read_key_file(options.key_file);
  const bool isolated = prepare_network(options);
  if (options.run_id == 0) {
    options.run_id = std::chrono::duration_cast<std::chrono::microseconds>(
                         std::chrono::system_clock::now().time_since_epoch())
                         .count();
  }

  Progress progress(scenario.loop.num_ticks, scenario.loop.period_s);
  Heartbeats heartbeats(options.lcm_url, key, scenario, options.run_id);
  Screen screen(options.quiet);
  std::optional<Window> window;
  if (options.visualize) window.emplace(options, isolated, screen);
  const Directory out(options.out.empty() ? fs::path("out") / scenario.name : options.out);
  SuperviseOptions supervise_options;
  if (scenario.loop.mode == experiment::Mode::realtime) {
    // The plant first brings the robot to rest, once it misses what was lost.
    const double noticed_s =
        std::min(scenario.loop.give_up_s, scenario.loop.period_s * (scenario.loop.max_missed + 1));
    supervise_options.grace +=
        plant::RealtimeLoop::longest_stop +
        std::chrono::milliseconds(static_cast<std::int64_t>(1e3 * noticed_s));
  }
  supervise_options.on_line = [&](std::string_view name, std::string_view line) {
    screen.pass_on(name, line);
  };
  supervise_options.on_restart = [&](std::string_view name, const std::string& how) {
    screen.clear();
    diagnostics::log_warning(how + "; another " + std::string(name) +
                             " has been started in its place");
  };
  supervise_options.on_wake = [&] {
    heartbeats.read_into(progress);
    screen.show(progress);
    if (window) window->attend();
  };
  const Clock::time_point begun = Clock::now();
  const Supervision supervision = supervise(processes(options, out), supervise_options);
  if (window) window->run_is_over(supervision.interrupted);
  screen.clear();

  report::RunFacts facts;
  facts.scenario = scenario.name;
  facts.run_id = options.run_id;
  facts.mode = scenario.loop.mode == experiment::Mode::lockstep ? "lockstep" : "realtime";
  facts.law = scenario.controller.law;
  facts.period_s = scenario.loop.period_s;
  facts.wall_s = std::chrono::duration<double>(Clock::now() - begun).count();
  facts.log_path = (out / "lcmlog").string();
  facts.fault = fault_of(supervision);
  if (facts.fault) diagnostics::log_error(*facts.fault);

  report::Tracking tracking(scenario.num_joints);
  try {
    logger::RunLog log = logger::RunLog::open(facts.log_path, options.run_id);
    tracking = report::track(log);
    facts.log_ticks = static_cast<std::int64_t>(log.summary().ticks);
    facts.log_gaps = static_cast<std::int64_t>(log.summary().gaps());
  } catch (const diagnostics::Failure& failure) {
    diagnostics::log_warning(failure.what());
  }

  const nlohmann::ordered_json summary = summarise(facts, tracking, take_counters(out));
  const fs::path summary_path = out / "summary.json";
  if (!(std::ofstream(summary_path) << summary.dump(2) << "\n")) {
    diagnostics::log_warning("cannot write " + summary_path.string() + ": " + std::strerror(errno));
  }
  const report::JointUnits units = report::joint_units(model);
  report::FigureFacts figure{
      scenario.name + ": " + facts.law + ", h = " + report::short_period(facts.period_s),
      facts.period_s, units.length, units.effort};
  const fs::path figure_path = out / "tracking.svg";
  if (tracking.num_ticks() > 0) {
    try {
      report::draw(report::tracking_figure(tracking, figure, figure_path), figure_path);
      report::write_report({report::read_recorded_run(facts.log_path, options.run_id)},
                           out / "report.html");
    } catch (const diagnostics::Failure& failure) {
      diagnostics::log_warning(failure.what());
    }
  }

  if (options.json) {
    std::cout << summary.dump(2) << "\n";
  } else if (!options.quiet) {
    std::cout << "\n"
              << figure.title << "\n\n"
              << report::closing_table(summary, figure.length_units, figure.effort_units) << "\n";
    for (const char* file : our_files) {
      if (fs::exists(out / file)) std::cout << "  " << (out / file).string() << "\n";
    }
  }
  if (window) window->finish(options.quiet);
  return exit_code(supervision);
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  node::add_scenario(command, options->scenario, options->overrides);
  command.add_option("--out", options->out,
                     "Where log, summary and figure go; default: out/<the scenario's name>. "
                     "Files of an earlier run are replaced");
  node::add_run_id(command, "--run-id", options->run_id,
                   "Positive number in every message of the run; default: the time");
  command
      .add_option("--mode", options->mode,
                  "lockstep: simulation time, as fast as it goes; realtime: the wall clock")
      ->check(CLI::IsMember({"lockstep", "realtime"}));
  command.add_option("--duration", options->duration_s, "Length of the run [s]");
  node::add_lcm_url(command, options->lcm_url);
  node::add_key_file(command, options->key_file);
  command
      .add_option(
          "--restart", options->restart,
          "Start this process again when a signal kills it, 5 times at most; lockstep only. "
          "The run goes on from its log, to the same result")
      ->check(CLI::IsMember({"controller"}));
  command.add_flag("--isolate", options->isolate,
                   "Run in a private network namespace; also TACHLESS_ISOLATE=1");
  command.add_flag(
      "--visualize", options->visualize,
      "Show the robot in Simbody's 3D window, at the simulated pace, to the end of the "
      "motion; closing the window does not end the run");
  command.add_flag("-q,--quiet", options->quiet, "No progress and no table");
  command.add_flag("--json", options->json, "The summary on stdout, instead of the table");
  return [options] { return run_scenario(*options); };
}

}  // namespace

extern const Verb run;
const Verb run = {
    "run", "Run an experiment: four processes, a log, a summary, a figure",
    "  tachless run scenarios/paper_rigid.yaml\n"
    "  tachless run scenarios/paper_rigid.yaml --duration 0.5 --set 'controller.gains.kp=[400, "
    "300]'\n"
    "  tachless run scenarios/practical_rigid.yaml --mode realtime --out out/rt --isolate\n"
    "  tachless run scenarios/iiwa_point_to_point.yaml --visualize",
    declare};

}  // namespace tachless::launch::verb
