#include "launch/run_session.h"

#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <deque>
#include <iostream>
#include <numeric>
#include <optional>
#include <utility>

#include "bus/authenticated.h"
#include "bus/open_bus.h"
#include "bus/wire.h"
#include "diagnostics/logging.h"
#include "launch/doctor.h"
#include "launch/in_process.h"
#include "launch/progress.h"
#include "launch/run_results.h"
#include "launch/run_verdict.h"
#include "launch/run_window.h"
#include "launch/screen.h"
#include "node/key_file.h"
#include "plant/realtime_loop.h"
#include "process/interruption.h"
#include "study/in_process_loop.h"

namespace tachless::launch {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

/// What one robot's run is about, known before anything is started.
struct Planned {
  RunOptions options;
  experiment::Scenario scenario;
  RunVerdict verdict;
};

/// Reads the controller's heartbeats. Only listens.
class Heartbeats {
 public:
  Heartbeats(const RunOptions& options, const experiment::Scenario& scenario,
             const std::optional<bus::Key>& key)
      : transport_(bus::open_bus(node::parse_lcm_url(options.lcm_url))),
        codec_({scenario.num_joints, scenario.robot.flexible ? scenario.num_joints : 0, 0}),
        run_(options.run_id) {
    if (key) authenticated_.emplace(*transport_, *key);
    transport_->subscribe(loop::channel<loop::Participant>(scenario.robot.channel_prefix));
  }

  void read_into(Progress& progress) {
    try {
      while (const auto datagram = deaf_ ? std::nullopt : transport().receive({})) {
        loop::Stamp stamp;
        loop::Participant participant;
        if (codec_.decode(datagram->payload, stamp, participant) == bus::Rejection::none &&
            stamp.run == run_ && participant.role == loop::Role::controller) {
          progress.note(stamp.tick, participant.error_norm, Clock::now());
        }
      }
    } catch (const diagnostics::Failure&) {
      deaf_ = true;  // the programs lose the bus with it, and say so
    }
  }

  /// Listens until `until`.
  /// @throw diagnostics::Failure(protocol_violated) when a robot of this name has its processes
  /// here
  void require_free_bus(loop::Clock::time_point until) {
    while (loop::Clock::now() < until) {
      const auto datagram = transport().receive(until);
      loop::Stamp stamp;
      loop::Participant other;
      if (!datagram || codec_.decode(datagram->payload, stamp, other) != bus::Rejection::none ||
          other.state == loop::ParticipantState::finished ||
          other.state == loop::ParticipantState::fault) {
        continue;
      }
      throw diagnostics::Failure(diagnostics::ExitCode::protocol_violated,
                                 "another run is on this bus: there is already the {} (process {} "
                                 "on {}, {}); run beside it with --isolate, or end it first",
                                 loop::name(other.role), other.pid, other.host, datagram->sender);
    }
  }

 private:
  bus::Transport& transport() {
    return authenticated_ ? static_cast<bus::Transport&>(*authenticated_) : *transport_;
  }

  std::unique_ptr<bus::Transport> transport_;
  bool deaf_ = false;  ///< the bus is gone
  std::optional<bus::Authenticated> authenticated_;
  bus::Codec<loop::Participant> codec_;
  std::int64_t run_;
};

SuperviseOptions supervise_options(const Planned& run, Screen& screen) {
  const experiment::Scenario& scenario = run.scenario;
  SuperviseOptions options;
  if (scenario.loop.mode == experiment::Mode::realtime) {
    // The plant first brings the robot to rest, once it misses what was lost.
    const double noticed_s =
        std::min(scenario.loop.give_up_s, scenario.loop.period_s * (scenario.loop.max_missed + 1));
    options.grace += plant::RealtimeLoop::longest_stop +
                     std::chrono::milliseconds(static_cast<std::int64_t>(1e3 * noticed_s));
  }
  options.on_line = [&](std::string_view name, std::string_view line) {
    screen.pass_on(run.options.named(""), name, line);
  };
  options.on_restart = [&](std::string_view name, const std::string& how) {
    screen.clear();
    diagnostics::log_warning(
        run.options.named(fmt::format("{}; another {} has been started in its place", how, name)));
  };
  return options;
}

/// Who else ended because of the first cause, in one line, and what helps.
void tell_others(const Supervision& supervision, const RunOptions& options) {
  if (options.verbose) {
    for (const ProcessEnd& end : supervision.ends) {
      if (end.failed()) diagnostics::log_info(options.named(describe(end)));
    }
  }
  const std::string others = others_that_failed(supervision);
  if (!supervision.interrupted && !others.empty()) {
    diagnostics::log_info(options.named(fmt::format(
        "because of it ended: {}{}", others, options.verbose ? "" : "; details with --verbose")));
  }
  if (exit_code(supervision) != diagnostics::ExitCode::check_said_no) return;
  for (const Finding& finding : examine_punctuality()) {
    diagnostics::log_info("{}: {}; type: {}", finding.subject, finding.what,
                          finding.remedy.value_or("tachless doctor"));
  }
}

/// Tells of the runs one after another what has become of them, and of several at the end in one
/// table; their JSON is one object, by robot.
class Conclusions {
 public:
  void add(const Planned& run, RunDirectory& out, const RunEnd& end,
           const std::function<void()>& tell_others) {
    const RunOptions& options = run.options;
    const bool several = !options.robot.empty();
    braces_ = options.json && several;
    if (braces_) std::cout << fmt::format("{}\"{}\": ", count_ == 0 ? "{" : ",", options.robot);
    const Concluded concluded = conclude(run.scenario, options, out, end, tell_others);
    if (code_ == diagnostics::ExitCode::done) code_ = concluded.code;
    if (several && !options.json && !options.quiet) rows_ += concluded.row;
    ++count_;
  }
  /// The exit code of the first that did not end well.
  [[nodiscard]] diagnostics::ExitCode finish() const {
    if (braces_) std::cout << "}\n";
    if (!rows_.empty()) std::cout << "\n" << report::overview_head() << rows_;
    return code_;
  }

 private:
  bool braces_ = false;
  std::string rows_;
  int count_ = 0;
  diagnostics::ExitCode code_ = diagnostics::ExitCode::done;
};

/// A run whose four processes are on the bus.
struct OnTheBus {
  OnTheBus(const Planned& planned, const std::optional<bus::Key>& key)
      : run(planned),
        placement(choose_placement(planned.options.placement, planned.scenario.loop.mode)),
        heartbeats(planned.options, planned.scenario, key) {}

  const Planned& run;
  Placement placement;
  Heartbeats heartbeats;
  std::optional<RunWindow> window;
  std::optional<RunDirectory> out;
};

/// Whether the program of --controller ended as if all was well, but without the counters that a
/// controller leaves.
bool program_took_no_part(const RunOptions& options, const Supervision& supervision,
                          const std::vector<node::Statistics>& statistics) {
  const std::string_view controller = loop::name(loop::Role::controller);
  return !options.law_program.empty() &&
         std::ranges::any_of(supervision.ends,
                             [&](const ProcessEnd& end) {
                               return end.name == controller && !end.failed() && !end.on_order;
                             }) &&
         std::ranges::none_of(statistics, [](const node::Statistics& of) {
           return of.role == loop::Role::controller;
         });
}

/// @param culprit the robot whose failure interrupted the run, if one has
RunEnd end_of(const Supervision& supervision, const std::string& culprit, const OnTheBus& robot,
              double wall_s) {
  RunEnd end{
      exit_code(supervision), {}, wall_s, robot.out->take_statistics(), robot.placement.words};
  if (supervision.interrupted) {
    end.fault = "interrupted" + (culprit.empty() ? "" : ", because " + culprit + " failed");
  } else if (supervision.culprit) {
    end.fault = describe(supervision.ends[*supervision.culprit]);
  }
  if (program_took_no_part(robot.run.options, supervision, end.statistics)) {
    end.code = diagnostics::ExitCode::peer_lost;
    end.fault = fmt::format(
        "--controller '{}': ended without having taken part; has it a main that calls "
        "tachless::run_controller (Python: tachless.run_controller)?",
        robot.run.options.law_program);
  }
  return end;
}

/// Listens for longer than a process on the bus is silent: each announces itself every 100 ms.
/// @throw diagnostics::Failure as Heartbeats::require_free_bus
void require_free_bus(std::deque<OnTheBus>& robots) {
  const auto until = loop::Clock::now() + std::chrono::milliseconds(250);
  while (loop::Clock::now() < until) {
    for (OnTheBus& each : robots) {
      each.heartbeats.require_free_bus(
          std::min(until, loop::Clock::now() + std::chrono::milliseconds(5)));
    }
  }
}

std::vector<Supervision> supervise_all(std::deque<OnTheBus>& robots, Screen& screen) {
  std::vector<Progress> progress;
  for (const OnTheBus& each : robots) {
    const experiment::LoopSpec& loop = each.run.scenario.loop;
    progress.emplace_back(loop.num_ticks, loop.period_s, each.run.options.robot);
  }
  std::vector<Supervised> runs;
  for (std::size_t i = 0; i < robots.size(); ++i) {
    OnTheBus& robot = robots[i];
    SuperviseOptions options = supervise_options(robot.run, screen);
    options.on_wake = [&, i] {
      robot.heartbeats.read_into(progress[i]);
      screen.show(progress);
      robot.out->look();
      if (robot.window) robot.window->attend();
    };
    runs.push_back({run_processes(robot.run.options, robot.placement, *robot.out), options});
  }
  std::vector<Supervision> ends = supervise(runs);
  screen.clear();
  return ends;
}

diagnostics::ExitCode in_four_processes(const std::vector<Planned>& runs) {
  const RunOptions& common = runs.front().options;
  const bool isolated = prepare_network(common);
  std::optional<bus::Key> key;  // last: a process whose memory is private cannot isolate itself
  if (!common.key_file.empty()) key = node::read_key_file(common.key_file);
  process::survive_broken_pipes();
  std::deque<OnTheBus> robots;
  for (const Planned& run : runs) robots.emplace_back(run, key);
  if (!isolated) require_free_bus(robots);
  Screen screen(common.quiet);
  for (OnTheBus& each : robots) {
    if (common.visualize) each.window.emplace(each.run.options, isolated, screen);
    each.out.emplace(each.run.options.directory(each.run.scenario));
  }
  for (const OnTheBus& each : robots) {
    say(each.run.verdict, each.run.options);
    diagnostics::log_detail(
        each.run.options.named(fmt::format("{}: {}", each.placement.words, each.placement.reason)));
  }
  const Clock::time_point begun = Clock::now();
  const std::vector<Supervision> ends = supervise_all(robots, screen);
  const double wall_s = std::chrono::duration<double>(Clock::now() - begun).count();
  for (std::size_t i = 0; i < ends.size(); ++i) {
    if (robots[i].window) robots[i].window->run_is_over(ends[i].interrupted);
  }
  std::vector<std::size_t> order(ends.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_partition(order.begin(), order.end(),
                        [&](std::size_t i) { return ends[i].failed(); });
  Conclusions conclusions;
  for (const std::size_t i : order) {
    const RunOptions& options = runs[i].options;
    const std::string culprit = ends[i].because_of ? runs[*ends[i].because_of].options.robot : "";
    const RunEnd end = end_of(ends[i], culprit, robots[i], wall_s);
    conclusions.add(runs[i], *robots[i].out, end, [&] {
      // The others have only waited for it.
      if (!program_took_no_part(options, ends[i], end.statistics)) tell_others(ends[i], options);
    });
  }
  for (OnTheBus& each : robots) {
    if (each.window) each.window->finish();
  }
  return conclusions.finish();
}

diagnostics::ExitCode in_this_process(const std::vector<Planned>& runs) {
  process::survive_broken_pipes();
  std::deque<RunDirectory> out;
  for (const Planned& run : runs) out.emplace_back(run.options.directory(run.scenario));
  Screen screen(runs.front().options.quiet);
  for (const Planned& run : runs) say(run.verdict, run.options);
  Conclusions conclusions;
  std::string failed;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const auto& [options, scenario, verdict] = runs[i];
    if (!failed.empty()) {
      diagnostics::log_error(options.named("not begun, because " + failed + " did not end well"));
      continue;
    }
    const RunEnd end = run_in_this_process(scenario, options, out[i] / "lcmlog", screen);
    screen.clear();
    conclusions.add(runs[i], out[i], end, [] {});
    if (end.code != diagnostics::ExitCode::done) failed = options.robot;
  }
  return conclusions.finish();
}

void cross_check(const Planned& run) {
  constexpr double most = 1e-8;  // the integrators' 1e-12 a step, and what a loop makes of it
  const study::CrossCheck check = study::cross_check(run.scenario);
  const std::string found =
      run.options.named(fmt::format("cross-check: Simbody and the native mechanics differ by "
                                    "{:.2g} rad at tick {} of {}, and nowhere by more",
                                    check.position, check.tick, check.ticks));
  if (!(check.position <= most)) {
    throw diagnostics::Failure(
        diagnostics::ExitCode::check_said_no,
        "{}; allowed: {:g}. The loop magnifies differences, or one of them is wrong", found, most);
  }
  if (!run.options.quiet) diagnostics::log_info(found);
}

}  // namespace

diagnostics::ExitCode run_session(RunOptions options, const std::vector<fs::path>& scenarios) {
  require_open_files(scenarios.size());
  if (options.run_id == 0) {
    options.run_id = std::chrono::duration_cast<std::chrono::microseconds>(
                         std::chrono::system_clock::now().time_since_epoch())
                         .count();
  }
  std::vector<Planned> runs;
  for (const fs::path& path : scenarios) {
    options.scenario = path;
    options.measurement = measurement_wanted(options);
    experiment::Scenario scenario = checked_scenario(options);
    if (scenarios.size() > 1) options.robot = scenario.robot.name;
    for (const Planned& other : runs) require_own_channels(other.scenario, scenario);
    runs.push_back({options, std::move(scenario), {}});
  }
  for (Planned& run : runs) run.verdict = judge(run.scenario, run.options);
  for (const Planned& run : runs) {
    if (run.options.cross_check) cross_check(run);
  }
  return options.in_process ? in_this_process(runs) : in_four_processes(runs);
}

}  // namespace tachless::launch
