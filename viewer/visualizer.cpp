#include "viewer/visualizer.h"

#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "bus/authenticated.h"
#include "bus/key.h"
#include "bus/udp_transport.h"
#include "bus/truth/truth_wire.h"
#include "diagnostics/failure.h"
#include "diagnostics/logging.h"
#include "diagnostics/version.h"
#include "experiment/scenario.h"
#include "node/options.h"
#include "plant/plant_model.h"
#include "process/display.h"
#include "process/process_tree.h"
#include "process/this_process.h"
#include "viewer/arm_window.h"
#include "viewer/pose_player.h"
#include "viewer/visuals.h"

namespace tachless::viewer {
namespace {

using loop::Clock;
using namespace std::chrono_literals;

constexpr auto frame_period = 33ms;
constexpr auto nap = 8ms;  // holds the socket's buffer easily at 20,000 ticks/s
// A picture that does not change is drawn again, for a window that was covered.
constexpr auto redraw_period = 500ms;
constexpr auto last_picture_stays = 1s;

struct Options {
  std::filesystem::path scenario;
  std::vector<std::string> overrides;
  std::string lcm_url = node::default_lcm_url;
  std::string key_file;
  std::int64_t run_id = 0;
};

/// Nothing when --help or --version was asked for and has been answered.
std::optional<Options> parse(int argc, const char* const* argv) {
  Options options;
  CLI::App cli("Shows the robot of a run, moving at the simulated pace, in a 3D window.",
               "tachless-visualizer");
  cli.footer(
      "Examples:\n"
      "  tachless run scenarios/practical_rigid.yaml --visualize\n"
      "  tachless-visualizer scenarios/practical_rigid.yaml\n"
      "Give it the run's scenario, with the same --set. It only listens, and may start at any "
      "time.\n"
      "Exit codes: 0 shown to the end or closed, 2 bad usage or no display, 130 interrupted.");
  cli.set_version_flag("--version", std::string(diagnostics::version),
                       "Print the version and exit");
  node::with_installed_scenarios(node::add_scenario(cli, options.scenario, options.overrides));
  node::add_lcm_url(cli, options.lcm_url);
  node::add_key_file(cli, options.key_file);
  node::as_run_id(cli.add_option("--run-id", options.run_id,
                                 "The run to show; default: the first that is heard"));
  if (!node::parse(cli, argc, argv)) return std::nullopt;
  return options;
}

/// Hears where a run's robot truly is. Only listens, and never waits on the socket: whoever sends
/// to a socket that a process waits on pays for waking it.
class TruthListener {
 public:
  /// @throw diagnostics::Failure(bad_usage)
  TruthListener(const Options& options, const experiment::Scenario& scenario)
      : truth_channel_(loop::channel<loop::truth::PlantTruth>(scenario.robot.channel_prefix)),
        truth_codec_(loop::layout(scenario.num_joints, scenario.robot.flexible.has_value())),
        participant_codec_(loop::Layout{}),
        period_s_(scenario.loop.period_s),
        run_(options.run_id) {
    std::optional<bus::Key> key;
    if (!options.key_file.empty()) key = bus::read_key_file(options.key_file);
    try {
      transport_ = std::make_unique<bus::UdpTransport>(node::parse_lcm_url(options.lcm_url));
      transport_->subscribe(truth_channel_);
      authenticated_.emplace(*transport_, key);
      if (key) {
        transport_->subscribe(loop::channel<loop::Participant>(scenario.robot.channel_prefix));
      }
    } catch (const std::system_error& error) {
      throw diagnostics::bad_usage("{}: {}", options.lcm_url, error.what());
    }
  }

  /// Hands over every pose that has arrived: simulated time [s] and link positions [rad; m]. The
  /// plant repeats itself: poses come twice and out of order.
  template <class OnPose>
  void drain(const OnPose& on_pose) {
    while (const auto datagram = authenticated_->receive(Clock::time_point{})) {
      if (datagram->channel != truth_channel_) {
        note_plant(*datagram);
      } else if (truth_codec_.decode(datagram->payload, stamp_, truth_) == bus::Rejection::none) {
        if (run_ == 0) run_ = stamp_.run;
        if (stamp_.run == run_) on_pose(static_cast<double>(stamp_.tick) * period_s_, truth_.q);
      }
    }
  }

 private:
  // On a bus with a key, truth verifies under one that is derived for the session besides.
  void note_plant(const bus::Datagram& datagram) {
    loop::Stamp stamp;
    loop::Participant participant;
    if (participant_codec_.decode(datagram.payload, stamp, participant) != bus::Rejection::none ||
        participant.role != loop::Role::plant || participant.roster == roster_ ||
        participant.roster == loop::PerRole{} || (run_ != 0 && stamp.run != run_)) {
      return;
    }
    roster_ = participant.roster;
    authenticated_->enter(stamp.run, roster_);
  }

  std::unique_ptr<bus::Transport> transport_;
  std::optional<bus::Authenticated> authenticated_;
  std::string truth_channel_;
  bus::Codec<loop::truth::PlantTruth> truth_codec_;
  bus::Codec<loop::Participant> participant_codec_;
  double period_s_;
  std::int64_t run_;        ///< 0: the first that is heard
  loop::PerRole roster_{};  ///< of the session whose key is known
  loop::Stamp stamp_;
  loop::truth::PlantTruth truth_;
};

std::atomic<bool> run_is_over{false};
void note_end_of_run(int /*signal*/) { run_is_over = true; }

void give_up_opening(int /*signal*/) {
  const std::string_view words[] = {"tachless-visualizer: ", viewer::ArmWindow::viewer_ended, "\n"};
  for (const std::string_view text : words) {
    [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, text.data(), text.size());
  }
  _exit(static_cast<int>(diagnostics::ExitCode::bad_usage));
}

/// Simbody does not go on with a write that a signal has interrupted: the kernel has to.
void handle(int signal, void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  sigaction(signal, &action, nullptr);
}

/// The process behind the window: the only child there is.
class Viewer {
 public:
  Viewer() {
    const std::vector<pid_t> children = process::children_of(getpid());
    if (!children.empty()) pid_ = children.front();
  }
  Viewer(const Viewer&) = delete;
  Viewer& operator=(const Viewer&) = delete;
  /// Whatever state it is in: Simbody waits for its end without a limit.
  ~Viewer() {
    if (pid_ > 0) kill(pid_, SIGKILL);
  }

  /// It has ended, or has no connection to the display any more: one whose window was killed may
  /// never get to its end, for it waits for its own threads while it exits.
  bool window_is_closed() {
    if (waitpid(-1, nullptr, WNOHANG) > 0) {
      pid_ = 0;
      return true;
    }
    const bool connected = process::has_socket(pid_);
    was_connected_ = was_connected_ || connected;
    return was_connected_ && !connected;
  }

  [[nodiscard]] pid_t pid() const { return pid_; }

 private:
  pid_t pid_ = 0;
  bool was_connected_ = false;
};

void open(std::optional<viewer::ArmWindow>& window, const experiment::Scenario& scenario,
          const robot::Model& model, const Visuals& visuals) {
  const std::string& carrier = scenario.plant.payload.link;
  const std::vector<std::string> tools = model.frames.count(carrier) != 0
                                             ? std::vector<std::string>{carrier}
                                             : robot::farthest_leaves(model);
  const robot::Vector initial = plant::initial_state(scenario, model).q;
  handle(SIGCHLD, give_up_opening);
  window.emplace(model, visuals, tools, initial, "tachless: " + scenario.name,
                 process::shared_directory() / "simbody");
  handle(SIGCHLD, SIG_DFL);
}

diagnostics::ExitCode show(const Options& options) {
  const experiment::Scenario scenario =
      experiment::load_scenario(options.scenario, options.overrides);
  const robot::Model model = plant::plant_model(scenario);
  if (const auto problem = process::display_problem()) {
    throw diagnostics::bad_usage(*problem);
  }
  handle(SIGPIPE, SIG_IGN);
  TruthListener listener(options, scenario);
  std::optional<viewer::ArmWindow> window;
  const Visuals visuals =
      read_visuals(options.scenario.parent_path() / scenario.robot.urdf_path, model);
  open(window, scenario, model, visuals);
  Viewer viewer;  // ended before the window
  const std::atomic<bool>& interrupted = process::catch_interruptions(SA_RESTART);
  handle(SIGUSR1, note_end_of_run);
  std::cout << window_is_open << std::endl;
  // Not before, when a run takes what is said for the reason why there is no window.
  if (const auto warning = visuals.warning()) diagnostics::log_warning(*warning);

  PosePlayer player(static_cast<double>(scenario.loop.num_ticks - 1) * scenario.loop.period_s);
  Clock::time_point next_frame{}, next_redraw{}, close_at = Clock::time_point::max();
  std::optional<double> shown_s;
  bool run_has_begun = false;
  while (!interrupted) {
    // Looked at before what has come: what was sent before the end is shown.
    const bool over = run_is_over;
    listener.drain([&](double t_s, const robot::Vector& q) {
      // Not before: on a busy machine the window would not open.
      if (!std::exchange(run_has_begun, true)) {
        process::set_idle_priority(getpid());
        process::set_idle_priority(viewer.pid());
      }
      player.add(t_s, q, Clock::now());
    });
    if (over) player.end();
    if (viewer.window_is_closed()) return diagnostics::ExitCode::done;
    const Clock::time_point now = Clock::now();
    if (now >= next_frame) {
      next_frame = now + frame_period;
      const auto pose = player.at(now);
      if (pose && (pose->t_s != shown_s || now >= next_redraw)) {
        window->show(pose->t_s, pose->q);
        shown_s = pose->t_s;
        next_redraw = now + redraw_period;
      }
      if (player.finished()) close_at = std::min(close_at, now + last_picture_stays);
      if (now >= close_at) return diagnostics::ExitCode::done;
    }
    poll(nullptr, 0, static_cast<int>(nap.count()));
  }
  return diagnostics::ExitCode::interrupted;
}

}  // namespace
}  // namespace tachless::viewer

/// The program tachless-visualizer: the robot of a run, moving, in Simbody's window. Listens to the
/// bus and says nothing there. Ends with 0 when it has shown the whole run or the window was
/// closed. SIGUSR1 tells it that the run is over, wherever it stopped.
int main(int argc, char** argv) {
  using namespace tachless;
  diagnostics::start_logging("tachless-visualizer", diagnostics::Verbosity::normal);
  try {
    const std::optional<viewer::Options> options = viewer::parse(argc, argv);
    return static_cast<int>(options ? viewer::show(*options) : diagnostics::ExitCode::done);
  } catch (const std::exception&) {
    return diagnostics::told_exception("the command line");
  }
}
