#include "launch/run_session.h"

#include <fmt/core.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <optional>
#include <thread>

#include "bus/authenticated.h"
#include "bus/udp_transport.h"
#include "bus/wire.h"
#include "diagnostics/logging.h"
#include "launch/doctor.h"
#include "launch/in_process.h"
#include "launch/progress.h"
#include "launch/run_results.h"
#include "launch/run_verdict.h"
#include "launch/screen.h"
#include "node/key_file.h"
#include "plant/realtime_loop.h"
#include "process/interruption.h"
#include "process/side_process.h"
#include "viewer/visualizer.h"

namespace tachless::launch {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

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
    while (const auto datagram = transport().receive(loop::Clock::time_point{})) {
      loop::Stamp stamp;
      loop::Participant participant;
      if (codec_.decode(datagram->payload, stamp, participant) == bus::Rejection::none &&
          stamp.run == run_ && participant.role == loop::Role::controller) {
        progress.note(stamp.tick, participant.error_norm, Clock::now());
      }
    }
  }

  /// Listens for longer than a process on the bus is silent: each announces itself every 100 ms.
  /// @throw diagnostics::Failure(protocol_violated) when a robot of this name has its processes
  /// here
  void require_free_bus() {
    const auto until = loop::Clock::now() + std::chrono::milliseconds(250);
    while (loop::Clock::now() < until) {
      const auto datagram = transport().receive(until);
      loop::Stamp stamp;
      loop::Participant other;
      if (!datagram || codec_.decode(datagram->payload, stamp, other) != bus::Rejection::none ||
          other.state == loop::ParticipantState::finished ||
          other.state == loop::ParticipantState::fault) {
        continue;
      }
      throw diagnostics::Failure(
          diagnostics::ExitCode::protocol_violated,
          fmt::format("another run is on this bus: there is already the {} (process {} on {}, {}); "
                      "run beside it with --isolate, or end it first",
                      loop::name(other.role), other.pid, other.host, datagram->sender));
    }
  }

 private:
  bus::Transport& transport() {
    return authenticated_ ? static_cast<bus::Transport&>(*authenticated_) : transport_;
  }

  bus::UdpTransport transport_;
  std::optional<bus::Authenticated> authenticated_;
  bus::Codec<loop::Participant> codec_;
  std::int64_t run_;
};

/// Simbody's 3D window beside the run. Closing it is reported but does not stop the run.
class Window {
 public:
  /// @throw diagnostics::Failure(bad_usage) when none can be opened
  Window(const RunOptions& options, bool isolated, Screen& screen) : screen_(screen) {
    std::vector<std::string> command = command_of("tachless-visualizer", options);
    command.insert(command.end(), {"--run-id", std::to_string(options.run_id)});
    constexpr std::string_view itself = "tachless-visualizer: ";
    try {
      program_.emplace("tachless-visualizer", command, viewer::window_is_open,
                       std::chrono::seconds(30),
                       [&](std::string_view line) { screen_.pass_on("visualizer", line); });
    } catch (const diagnostics::Failure& failure) {
      std::string_view why = failure.what();
      if (why.starts_with(itself)) why.remove_prefix(itself.size());
      throw diagnostics::Failure(
          failure.code(),
          fmt::format(
              "--visualize: {}; or leave out --visualize{}", why,
              isolated ? " (this run is isolated: it reaches no display over the network)" : ""));
    }
  }

  void attend() {
    if (!program_->running()) return;
    program_->attend();
    if (program_->running()) return;
    const std::string& trouble = program_->trouble();
    screen_.clear();
    diagnostics::log_warning(
        fmt::format("the window {}; the run goes on",
                    trouble.empty() ? "was closed" : fmt::format("is gone: {}", trouble)));
  }

  /// The run is over: what is left to show will be shown.
  void run_is_over(bool interrupted) { interrupted ? program_->stop() : program_->signal(SIGUSR1); }

  /// Waits until the window has shown everything, is closed, or the user interrupts.
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

SuperviseOptions supervise_options(const experiment::Scenario& scenario, Screen& screen) {
  SuperviseOptions options;
  if (scenario.loop.mode == experiment::Mode::realtime) {
    // The plant first brings the robot to rest, once it misses what was lost.
    const double noticed_s =
        std::min(scenario.loop.give_up_s, scenario.loop.period_s * (scenario.loop.max_missed + 1));
    options.grace += plant::RealtimeLoop::longest_stop +
                     std::chrono::milliseconds(static_cast<std::int64_t>(1e3 * noticed_s));
  }
  options.on_line = [&](std::string_view name, std::string_view line) {
    screen.pass_on(name, line);
  };
  options.on_restart = [&](std::string_view name, const std::string& how) {
    screen.clear();
    diagnostics::log_warning(
        fmt::format("{}; another {} has been started in its place", how, name));
  };
  return options;
}

RunEnd end_of(const Supervision& supervision, const RunDirectory& out, double wall_s) {
  RunEnd end{exit_code(supervision), {}, wall_s, out.take_statistics()};
  if (supervision.interrupted) {
    end.fault = "interrupted";
  } else if (supervision.culprit) {
    end.fault = describe(supervision.ends[*supervision.culprit]);
  }
  return end;
}

/// Who else ended because of the first cause, in one line, and what helps.
void tell_others(const Supervision& supervision, const RunOptions& options) {
  if (options.verbose) {
    for (const ProcessEnd& end : supervision.ends) {
      if (end.failed()) diagnostics::log_info(describe(end));
    }
  }
  const std::string others = others_that_failed(supervision);
  if (!supervision.interrupted && !others.empty()) {
    diagnostics::log_info(fmt::format("because of it ended: {}{}", others,
                                      options.verbose ? "" : "; details with --verbose"));
  }
  if (exit_code(supervision) != diagnostics::ExitCode::check_said_no) return;
  for (const Finding& finding : examine_punctuality()) {
    diagnostics::log_info(fmt::format("{}: {}; type: {}", finding.subject, finding.what,
                                      finding.remedy.value_or("tachless doctor")));
  }
}

fs::path directory_of(const experiment::Scenario& scenario, const RunOptions& options) {
  return options.out.empty() ? fs::path("out") / scenario.name : options.out;
}

diagnostics::ExitCode in_four_processes(const experiment::Scenario& scenario,
                                        const RunVerdict& verdict, const RunOptions& options) {
  const bool isolated = prepare_network(options);
  std::optional<bus::Key> key;  // last: a process whose memory is private cannot isolate itself
  if (!options.key_file.empty()) key = node::read_key_file(options.key_file);
  process::survive_broken_pipes();
  Progress progress(scenario.loop.num_ticks, scenario.loop.period_s);
  Heartbeats heartbeats(options.lcm_url, key, scenario, options.run_id);
  if (!isolated) heartbeats.require_free_bus();
  Screen screen(options.quiet);
  std::optional<Window> window;
  if (options.visualize) window.emplace(options, isolated, screen);
  RunDirectory out(directory_of(scenario, options));
  SuperviseOptions supervising = supervise_options(scenario, screen);
  supervising.on_wake = [&] {
    heartbeats.read_into(progress);
    screen.show(progress);
    out.look();
    if (window) window->attend();
  };
  say(verdict, options.quiet);
  const Clock::time_point begun = Clock::now();
  const Supervision supervision = supervise(run_processes(options, out), supervising);
  if (window) window->run_is_over(supervision.interrupted);
  screen.clear();
  const double wall_s = std::chrono::duration<double>(Clock::now() - begun).count();
  const auto code = conclude(scenario, options, out, end_of(supervision, out, wall_s),
                             [&] { tell_others(supervision, options); });
  if (window) window->finish(options.quiet);
  return code;
}

diagnostics::ExitCode in_this_process(const experiment::Scenario& scenario,
                                      const RunVerdict& verdict, const RunOptions& options) {
  process::survive_broken_pipes();
  RunDirectory out(directory_of(scenario, options));
  Screen screen(options.quiet);
  say(verdict, options.quiet);
  const RunEnd end = run_in_this_process(scenario, options.run_id, out / "lcmlog", screen);
  screen.clear();
  return conclude(scenario, options, out, end, [] {});
}

}  // namespace

diagnostics::ExitCode run_session(RunOptions options) {
  require_open_files();
  const experiment::Scenario scenario = checked_scenario(options);
  const RunVerdict verdict = judge(scenario, options);
  if (options.run_id == 0) {
    options.run_id = std::chrono::duration_cast<std::chrono::microseconds>(
                         std::chrono::system_clock::now().time_since_epoch())
                         .count();
  }
  return options.in_process ? in_this_process(scenario, verdict, options)
                            : in_four_processes(scenario, verdict, options);
}

}  // namespace tachless::launch
