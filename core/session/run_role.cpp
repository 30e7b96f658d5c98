#include "session/run_role.h"

#include <fmt/core.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <optional>
#include <system_error>

#include "base/logging.h"
#include "base/this_process.h"
#include "bus/udp_transport.h"

namespace tachless::session {
namespace {

using namespace std::chrono_literals;
using base::ExitCode;
using base::Failure;

/// Opens the bus of a process.
/// @throw base::Failure(bad_usage) naming the URL and the operation that the host refused
void open_bus(std::optional<bus::UdpTransport>& bus, const ProcessOptions& options,
              messages::Role role, const scenario::Scenario& scenario) {
  const bus::LcmUrl where = parse_lcm_url(options.lcm_url);
  try {
    bus.emplace(where);
  } catch (const std::system_error& problem) {
    throw base::bad_usage("{}: {}", options.lcm_url, problem.what());
  }
  base::log_detail("bus {}, receive buffer {} bytes", where.text(), bus->receive_buffer_bytes());
  // No process waits for a lockstep logger until the plant's window of ticks is full.
  if (role == messages::Role::logger && scenario.loop.mode == scenario::Mode::lockstep) {
    bus->read_in_batches(500us);
  }
}

/// Warns of unsent messages. The other processes cannot report them, because to them the messages
/// are only missing.
void report_unsent(const std::optional<bus::UdpTransport>& bus) {
  if (!bus || bus->statistics().unsent == 0) return;
  base::log_warning("{} messages could not be sent ({}); run tachless doctor for details",
                    bus->statistics().unsent, std::strerror(bus->statistics().refusal));
}

/// Touches the stack that a tick may use, so that no tick faults a page of it. A step of a law
/// takes 112 kB of stack for seven joints at most, and more for more joints.
[[gnu::noinline]] void touch_stack() {
  constexpr std::size_t size = 512 * 1024, page = 4096;
  std::array<volatile char, size> stack;
  for (std::size_t i = 0; i < size; i += page) stack[i] = 0;
}

/// Requests realtime properties of the kernel for the calling thread, before the run begins. The
/// properties are memory that is not paged out (mlockall), and timers without slack. All roles but
/// the logger also get the scheduling class SCHED_FIFO, which no ordinary process preempts. Without
/// permission the process runs nevertheless. One line at level info then says which property is
/// missing and how to permit it.
void request_real_time(messages::Role role) {
  // Priorities by role, below the kernel's own threads (99). The plant sets the pace and comes
  // first. The controller comes second, because it has to reply within the tick; the reference is a
  // tick ahead.
  static constexpr std::array<int, messages::num_roles> priorities = {80, 78, 79, 0};
  std::string missing;
  ::prctl(PR_SET_TIMERSLACK, 1UL);  // [ns]; the kernel's default is 50 us
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    missing += fmt::format("its memory locked ({}; ulimit -l unlimited)", std::strerror(errno));
  }
  touch_stack();
  sched_param parameters{};
  parameters.sched_priority = priorities.at(static_cast<std::size_t>(role));
  if (parameters.sched_priority > 0 &&
      ::sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters) != 0) {
    missing +=
        fmt::format("{}SCHED_FIFO priority {} ({}; ulimit -r {})", missing.empty() ? "" : " and ",
                    parameters.sched_priority, std::strerror(errno), parameters.sched_priority);
  }
  if (missing.empty()) return;
  base::log_info(
      "realtime without {}; to permit it permanently, add the lines * - rtprio 90 and * - memlock "
      "unlimited in "
      "/etc/security/limits.d/realtime.conf, then log in again",
      missing);
}

Session::Config session_config(messages::Role role, const ProcessOptions& options,
                               const std::atomic<bool>& interrupted) {
  Session::Config config;
  config.role = role;
  config.run_id = options.run_id;
  config.wait_s = options.wait_s;
  config.interrupted = &interrupted;
  config.key = bus::read_key_file(options.key_path);
  base::log_detail(config.key
                       ? fmt::format("messages have the tag of the key in {}", options.key_path)
                       : "messages have no tag: no --key-file");
  return config;
}

}  // namespace

ExitCode run_role(messages::Role role, const ProcessOptions& options, const RoleMain& main) {
  const std::atomic<bool>& interrupted = base::catch_interruptions();
  base::survive_file_size_limit();
  std::optional<bus::UdpTransport> bus;
  std::optional<Session> session;
  Statistics early(role);  // statistics of a process that ends before it has a session
  const auto statistics = [&]() -> Statistics& { return session ? session->statistics() : early; };
  const auto report = [&] {
    report_unsent(bus);
    if (session) statistics().rejected.add(Discard::unauthenticated, session->unauthenticated());
    if (!options.stats_path.empty()) write_statistics(statistics(), options.stats_path);
  };
  try {
    const scenario::Scenario scenario =
        scenario::load_scenario(find_scenario(options.scenario_path), options.overrides);
    open_bus(bus, options, role, scenario);
    session.emplace(scenario, *bus, session_config(role, options, interrupted));
    if (scenario.loop.mode == scenario::Mode::realtime) request_real_time(role);
    session->guard([&] { main(scenario, *session); });
  } catch (const std::exception&) {
    const Failure failure = base::current_failure();
    statistics().exit_code = failure.code();
    statistics().fault = failure.what();
    try {
      report();
    } catch (const Failure& second) {
      base::log_warning(second.what());
    }
    throw;
  }
  report();
  // The run is complete, but one of its checks failed.
  if (statistics().fault) throw Failure(statistics().exit_code, *statistics().fault);
  return ExitCode::done;
}

}  // namespace tachless::session
