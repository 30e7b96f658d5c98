#include "node/run_role.h"

#include <fmt/core.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <system_error>

#include "bus/udp_transport.h"
#include "diagnostics/logging.h"
#include "process/this_process.h"

namespace tachless::node {
namespace {

using namespace std::chrono_literals;
using diagnostics::ExitCode;
using diagnostics::Failure;

/// Opens the bus of a process.
/// @throw diagnostics::Failure(bad_usage) naming the URL and what the host refused
void open_bus(std::optional<bus::UdpTransport>& bus, const ProcessOptions& options, loop::Role role,
              const experiment::Scenario& scenario) {
  const bus::LcmUrl where = parse_lcm_url(options.lcm_url);
  try {
    bus.emplace(where);
  } catch (const std::system_error& problem) {
    throw diagnostics::bad_usage("{}: {}", options.lcm_url, problem.what());
  }
  diagnostics::log_detail("bus {}, receive buffer {} bytes", where.text(),
                          bus->receive_buffer_bytes());
  // No one waits for a lock-step logger until the plant's window of ticks is full.
  if (role == loop::Role::logger && scenario.loop.mode == experiment::Mode::lockstep) {
    bus->read_in_batches(500us);
  }
}

/// The other processes cannot know: to them the messages are only missing.
void report_unsent(const std::optional<bus::UdpTransport>& bus) {
  if (!bus || bus->statistics().unsent == 0) return;
  diagnostics::log_warning("{} messages could not be sent ({}); `tachless doctor` looks closer",
                           bus->statistics().unsent, std::strerror(bus->statistics().refusal));
}

/// What a process of a realtime run requests of the kernel, for the calling thread, before the run
/// begins: memory that is not paged out (mlockall), timers without slack, and, for all roles but
/// the logger, the scheduling class SCHED_FIFO, which no ordinary process preempts. Without the
/// permission the process runs all the same, and one line at level info says what is missing and
/// how to permit it.
void request_real_time(loop::Role role) {
  // By role, below the kernel's own threads (99). The plant, which sets the pace, comes first, then
  // the controller, which has to reply within the tick; the reference is a tick ahead.
  static constexpr std::array<int, loop::num_roles> priorities = {80, 78, 79, 0};
  std::string missing;
  ::prctl(PR_SET_TIMERSLACK, 1UL);  // [ns]; 50 us otherwise
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    missing += fmt::format("its memory locked ({}; `ulimit -l unlimited`)", std::strerror(errno));
  }
  sched_param parameters{};
  parameters.sched_priority = priorities.at(static_cast<std::size_t>(role));
  if (parameters.sched_priority > 0 &&
      ::sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters) != 0) {
    missing +=
        fmt::format("{}SCHED_FIFO priority {} ({}; `ulimit -r {}`)", missing.empty() ? "" : " and ",
                    parameters.sched_priority, std::strerror(errno), parameters.sched_priority);
  }
  if (missing.empty()) return;
  diagnostics::log_info(
      "realtime without {}; for good: the lines `* - rtprio 90` and `* - memlock unlimited` in "
      "/etc/security/limits.d/realtime.conf, then log in again",
      missing);
}

Link::Config link_config(loop::Role role, const ProcessOptions& options,
                         const std::atomic<bool>& interrupted) {
  Link::Config config;
  config.role = role;
  config.run_id = options.run_id;
  config.wait_s = options.wait_s;
  config.interrupted = &interrupted;
  config.key = bus::read_key_file(options.key_path);
  diagnostics::log_detail(
      config.key ? fmt::format("messages have the tag of the key in {}", options.key_path)
                 : "messages have no tag: no --key-file");
  return config;
}

}  // namespace

ExitCode run_role(loop::Role role, const ProcessOptions& options, const RoleMain& main) {
  const std::atomic<bool>& interrupted = process::catch_interruptions();
  process::survive_file_size_limit();
  std::optional<bus::UdpTransport> bus;
  std::optional<Link> link;
  Statistics early(role);  // of a process that does not get as far as a session
  const auto statistics = [&]() -> Statistics& { return link ? link->statistics() : early; };
  const auto report = [&] {
    report_unsent(bus);
    if (link) statistics().rejected.add(Discard::unauthenticated, link->unauthenticated());
    if (!options.stats_path.empty()) write_statistics(statistics(), options.stats_path);
  };
  try {
    const experiment::Scenario scenario =
        experiment::load_scenario(find_scenario(options.scenario_path), options.overrides);
    open_bus(bus, options, role, scenario);
    link.emplace(scenario, *bus, link_config(role, options, interrupted));
    if (scenario.loop.mode == experiment::Mode::realtime) request_real_time(role);
    link->guard([&] { main(scenario, *link); });
  } catch (const std::exception&) {
    const Failure failure = diagnostics::current_failure();
    statistics().exit_code = failure.code();
    statistics().fault = failure.what();
    try {
      report();
    } catch (const Failure& second) {
      diagnostics::log_warning(second.what());
    }
    throw;
  }
  report();
  // The run went to its end, and a check of it said no.
  if (statistics().fault) throw Failure(statistics().exit_code, *statistics().fault);
  return ExitCode::done;
}

}  // namespace tachless::node
