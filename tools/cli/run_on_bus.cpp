#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <deque>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

#include "base/logging.h"
#include "base/this_process.h"
#include "bus/authenticated.h"
#include "bus/key.h"
#include "bus/udp_transport.h"
#include "cli/doctor.h"
#include "cli/progress.h"
#include "cli/run.h"
#include "cli/supervise.h"
#include "controller/law_socket.h"
#include "live/page_process.h"
#include "messages/wire.h"
#include "plant/node.h"
#include "session/options.h"

namespace tachless::cli {
namespace {

using base::ExitCode;
using base::Failure;
using Clock = std::chrono::steady_clock;

// Processes of one launcher find each other at once or never.
constexpr const char* rendezvous_s = "10";

/// A listener to the announcements of a robot's processes. It sends nothing.
class Heartbeats {
 public:
  Heartbeats(const PlannedRun& run, const std::optional<bus::Key>& key)
      : transport_(session::parse_lcm_url(run.options.lcm_url)),
        authenticated_(transport_, key),
        run_(run.options.run_id) {
    authenticated_.subscribe(
        messages::channel<messages::Participant>(run.scenario.robot.channel_prefix));
  }

  /// Notes in `progress` every announcement of the controller since the last call.
  void read_into(Progress& progress) {
    try {
      while (!bus_lost_ && receive({})) {
        if (announced_ && stamp_.run == run_ && participant_.role == messages::Role::controller) {
          progress.note(stamp_.tick, participant_.error_norm, Clock::now());
        }
      }
    } catch (const Failure&) {
      bus_lost_ = true;  // the programs lose the bus too, and report it
    }
  }

  /// Listens for an announcement, until `until` at the latest. @return whether one has come yet
  /// @throw base::Failure(protocol_violated) if a process of a robot of this name has announced
  /// itself twice; a single announcement may come from a recording
  bool require_free_bus(base::Clock::time_point until) {
    const auto sender = receive(until);
    if (!sender || !announced_ || participant_.state == messages::ParticipantState::finished ||
        participant_.state == messages::ParticipantState::fault) {
      return !heard_.empty();
    }
    const auto [known, first] = heard_.try_emplace(participant_.instance, stamp_.utime);
    if (first || stamp_.utime <= known->second) return true;
    throw Failure(ExitCode::protocol_violated,
                  "another run is on this bus: there is already the {} (process {} on {}, {}); run "
                  "beside it with --isolate, or end it first",
                  messages::name(participant_.role), participant_.pid, participant_.host, *sender);
  }

 private:
  /// Returns the sender of the next datagram. It sets `announced_` if that is an announcement.
  std::optional<std::string_view> receive(base::Clock::time_point until) {
    const auto datagram = authenticated_.receive(until);
    if (!datagram) return std::nullopt;
    announced_ =
        codec_.decode(datagram->payload, stamp_, participant_) == messages::Rejection::none;
    return datagram->sender;
  }

  bus::UdpTransport transport_;
  bus::Authenticated authenticated_;
  messages::Codec<messages::Participant> codec_{messages::Layout{}};
  bool bus_lost_ = false;
  std::int64_t run_;
  bool announced_ = false;
  messages::Stamp stamp_;
  messages::Participant participant_;
  std::map<std::int64_t, std::int64_t> heard_;  ///< when each instance announced itself [us]
};

/// A run whose four processes are on the bus.
struct OnTheBus {
  OnTheBus(const PlannedRun& planned, const std::optional<bus::Key>& key, std::size_t index)
      : run(planned),
        options(planned.options),
        placement(choose_placement(options.placement, planned.scenario.loop.mode, index)),
        heartbeats(planned, key) {}

  const PlannedRun& run;
  const RunOptions& options;
  Placement placement;
  Heartbeats heartbeats;
  std::optional<RunDirectory> out;
};

/// Returns the path of `program` beside this one, with the arguments for experiment and bus.
std::vector<std::string> command_of(const std::string& program, const RunOptions& options) {
  std::vector<std::string> command = {(base::program_directory() / program).string(),
                                      options.scenario.string(), "--lcm-url", options.lcm_url};
  if (!options.key_file.empty()) command.insert(command.end(), {"--key-file", options.key_file});
  for (const std::string& value : options.all_overrides()) {
    command.insert(command.end(), {"--set", value});
  }
  return command;
}

/// Returns the user's program in the place of a role's; empty: there is none.
std::string program_given(const RunOptions& options, messages::Role role) {
  if (role == messages::Role::controller) return options.law_program;
  return role == messages::Role::plant ? options.plant_program : "";
}

/// Returns the four processes, in the order in which they are started.
std::vector<Process> processes_of(const OnTheBus& robot) {
  const RunOptions& options = robot.options;
  const std::string log = (*robot.out / "lcmlog").string();
  std::vector<Process> all;
  for (const messages::Role role : roles) {
    std::vector<std::string> command = command_of(session::program_name(role), options);
    command.insert(command.end(),
                   {options.verbose ? "--verbose" : "--quiet", "--mark-levels", "--wait-s",
                    rendezvous_s, "--stats", robot.out->statistics_path(role).string()});
    if (role == messages::Role::plant) {
      command.insert(command.end(), {"--run-id", std::to_string(options.run_id)});
    }
    if (const std::string& program = program_given(options, role); !program.empty()) {
      command = controller::shell_command(program, {command.begin() + 1, command.end()});
    }
    if (role == messages::Role::logger) command.insert(command.end(), {"--out-log", log});
    all.push_back(
        {std::string(messages::name(role)), std::move(command), robot.placement.cpus_of(role)});
    all.back().relayed = robot.run.scenario.loop.mode == scenario::Mode::realtime;
    all.back().drives_robot = role == messages::Role::plant && !options.plant_program.empty();
  }
  return all;
}

/// Listens for longer than the 100 ms after which each process on the bus announces itself again.
/// After an announcement, it listens for the next one of that process.
/// @throw base::Failure as Heartbeats::require_free_bus
void require_free_bus(std::deque<OnTheBus>& robots) {
  constexpr std::chrono::milliseconds silence{250};
  const auto begin = base::Clock::now();
  for (auto until = begin + silence; base::Clock::now() < until;) {
    for (OnTheBus& each : robots) {
      const auto turn_ends = base::Clock::now() + std::chrono::milliseconds(5);
      if (each.heartbeats.require_free_bus(turn_ends)) until = begin + 2 * silence;
    }
  }
}

/// @param own index of the robot in `progress`, which is shown for all robots
SuperviseOptions supervise_options(OnTheBus& robot, std::vector<Progress>& progress,
                                   std::size_t own, Screen& screen) {
  const scenario::LoopSpec& loop = robot.run.scenario.loop;
  SuperviseOptions options;
  if (loop.mode == scenario::Mode::realtime) {
    // The plant first notices the loss, and then brings the robot to rest.
    const double noticed_s = std::min(loop.give_up_s, loop.period_s * (loop.max_missed + 1));
    options.grace +=
        plant::longest_stop + std::chrono::milliseconds(static_cast<std::int64_t>(1e3 * noticed_s));
  }
  const bool plant_alone = robot.options.trial && !robot.options.verbose;
  options.on_line = [&, plant_alone](std::string_view name, std::string_view line) {
    if (plant_alone && name != messages::name(messages::Role::plant)) return;
    screen.pass_on(robot.options.named(""), name, line);
  };
  options.begun = [&] { return robot.out->look(); };
  options.on_wake = [&, own] {
    robot.heartbeats.read_into(progress[own]);
    screen.show(progress);
    robot.out->look();
  };
  return options;
}

/// Returns what is wrong if a user's program ended well, but left no counters of its role; else
/// empty.
std::string never_joined(const RunOptions& options, const Supervision& supervision,
                         const std::vector<session::Statistics>& statistics) {
  for (const messages::Role role : {messages::Role::controller, messages::Role::plant}) {
    const std::string program = program_given(options, role);
    const auto ended_well = [&](const ProcessEnd& end) {
      return end.name == messages::name(role) && end.well() && !end.on_order;
    };
    if (program.empty() || std::ranges::none_of(supervision.ends, ended_well) ||
        std::ranges::find(statistics, role, &session::Statistics::role) != statistics.end()) {
      continue;
    }
    if (supervision.begun) {
      return fmt::format("--{} '{}': ended during the run without a message; see its code",
                         messages::name(role), program);
    }
    return fmt::format(
        "--{} '{}': ended without having taken part; has it a main that calls {}?",
        messages::name(role), program,
        role == messages::Role::plant
            ? "session::run_process and plant::run_driver (a simulator: plant::run_simulator)"
            : "tachless::run_controller (Python: tachless.run_controller)");
  }
  return {};
}

/// Returns whether a user's program could not start. It then ended before the run began, with the
/// exit code of a shell (126, 127) or an interpreter (1) that lacks the program.
bool could_not_start(const RunOptions& options, const Supervision& supervision) {
  if (supervision.interrupted || supervision.begun || !supervision.culprit) return false;
  const ProcessEnd& end = supervision.ends[*supervision.culprit];
  const auto is_users = [&](messages::Role role) {
    return end.name == messages::name(role) && !program_given(options, role).empty();
  };
  return (is_users(messages::Role::controller) || is_users(messages::Role::plant)) &&
         end.signal == 0 && (end.exit_code == 1 || end.exit_code == 126 || end.exit_code == 127);
}

/// Returns the other processes that ended because of the first cause, and remedies.
std::vector<std::string> consequences(const Supervision& supervision, const PlannedRun& run) {
  const RunOptions& options = run.options;
  std::vector<std::string> lines;
  if (options.verbose) {
    for (const ProcessEnd& end : supervision.ends) {
      if (!end.well()) lines.push_back(options.named(describe(end)));
    }
  }
  for (const ProcessEnd& end : supervision.ends) {
    if (end.dropped_bytes + end.hidden_lines == 0) continue;
    lines.push_back(options.named(
        fmt::format("{}: {} bytes of its output were dropped and {} lines were not shown, because "
                    "it writes faster than they are read",
                    end.name, end.dropped_bytes, end.hidden_lines)));
  }
  const std::string others = others_that_failed(supervision);
  if (!supervision.interrupted && !others.empty()) {
    lines.push_back(options.named(fmt::format("because of it ended: {}{}", others,
                                              options.verbose ? "" : "; details with --verbose")));
  }
  if (exit_code(supervision) != ExitCode::check_said_no ||
      run.scenario.loop.mode != scenario::Mode::realtime) {
    return lines;
  }
  for (const Finding& finding : examine_punctuality()) {
    lines.push_back(
        fmt::format("{}: {}; type: {}", finding.subject, finding.what, *finding.remedy));
  }
  return lines;
}

/// @param culprit the robot whose failure interrupted the run, if one has
void conclude(OnTheBus& robot, const Supervision& supervision, const std::string& culprit,
              double wall_s, Conclusions& conclusions) {
  RunEnd end{exit_code(supervision), {}, robot.out->take_statistics()};
  if (could_not_start(robot.options, supervision)) end.code = ExitCode::bad_usage;
  end.facts.wall_s = wall_s;
  end.facts.placement = robot.placement.words;
  for (const ProcessEnd& each : supervision.ends) {
    end.facts.dropped_output_bytes += each.dropped_bytes;
    end.facts.hidden_output_lines += each.hidden_lines;
    if (!each.robot_started) continue;
    end.facts.robot_stopped = each.robot_stopped;
    if (each.robot_stopped) continue;
    // The closing table says it too, but not with --quiet, in a ramp or while commissioning.
    base::log_warning(robot.options.named(fmt::format(
        "{}: robot NOT stopped: its driver ended first; use the emergency stop", each.name)));
  }
  if (supervision.interrupted) {
    end.facts.fault = "interrupted" + (culprit.empty() ? "" : ", because " + culprit + " failed");
  } else if (supervision.culprit) {
    end.facts.fault = describe(supervision.ends[*supervision.culprit]);
  }
  if (std::string absent = never_joined(robot.options, supervision, end.statistics);
      !absent.empty()) {
    end.code = ExitCode::peer_lost;
    end.facts.fault = std::move(absent);
  } else {  // otherwise the others have only waited for the program
    end.consequences = consequences(supervision, robot.run);
  }
  conclusions.add(robot.run, *robot.out, std::move(end));
}

}  // namespace

ExitCode run_on_bus(const std::vector<PlannedRun>& runs) {
  const RunOptions& common = runs.front().options;
  const bool isolated = prepare_network(common);
  if (isolated && common.watch) {
    throw base::bad_usage(
        "--watch: the run is in a private network, which a browser does not reach; run it without "
        "--isolate, and check the bus with tachless doctor");
  }
  // The page's process copies the memory of this one. It starts before the key is read.
  std::optional<live::PageProcess> page;
  if (common.watch) {
    live::RobotVisuals visuals;
    for (const PlannedRun& run : runs) visuals[run.scenario.robot.channel_prefix] = run.visuals();
    page.emplace(session::parse_lcm_url(common.lcm_url), visuals);
  }
  // The key is read last: a process whose memory is private cannot isolate itself.
  const std::optional<bus::Key> key = bus::read_key_file(common.key_file);
  base::survive_broken_pipes();
  Screen screen(common.quiet);
  std::deque<OnTheBus> robots;
  for (const PlannedRun& run : runs) robots.emplace_back(run, key, robots.size());
  if (!isolated) require_free_bus(robots);
  for (OnTheBus& each : robots) each.out.emplace(each.run);
  std::vector<Progress> progress;
  std::vector<Supervised> supervised;
  for (OnTheBus& each : robots) {
    each.run.print_remarks();
    base::log_detail(each.options.named(each.placement.words));
    progress.push_back(each.run.progress());
    supervised.push_back(
        {processes_of(each), supervise_options(each, progress, supervised.size(), screen)});
  }
  if (page) page->show();
  const Clock::time_point begun = Clock::now();
  const std::vector<Supervision> ends = supervise(supervised);
  const double wall_s = std::chrono::duration<double>(Clock::now() - begun).count();
  if (std::ranges::any_of(ends, &Supervision::interrupted)) base::give_up_blocked_output();
  screen.clear();
  std::vector<std::size_t> order(ends.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_partition(order.begin(), order.end(),
                        [&](std::size_t i) { return ends[i].failed(); });
  Conclusions conclusions;
  for (const std::size_t i : order) {
    const std::string culprit = ends[i].because_of ? robots[*ends[i].because_of].options.robot : "";
    conclude(robots[i], ends[i], culprit, wall_s, conclusions);
  }
  return conclusions.finish();
}

}  // namespace tachless::cli
