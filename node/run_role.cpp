#include "node/run_role.h"

#include <cstring>
#include <optional>
#include <stdexcept>
#include <system_error>

#include "bus/authenticated.h"
#include "bus/channelwise_transport.h"
#include "bus/udp_transport.h"
#include "diagnostics/logging.h"
#include "node/key_file.h"
#include "node/options.h"
#include "node/real_time.h"
#include "process/interruption.h"

namespace tachless::node {
namespace {

void join(std::optional<bus::UdpTransport>& transport, const std::string& url) {
  const bus::LcmUrl where = parse_lcm_url(url);
  try {
    transport.emplace(where);
  } catch (const std::system_error& problem) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage, url + ": " + problem.what());
  }
}

/// Nothing is repeated for a realtime logger: what its buffers do not hold while it waits for a
/// processor is lost.
bool needs_more_buffers(loop::Role role, const experiment::Scenario& scenario,
                        const bus::UdpTransport& transport) {
  constexpr int enough_bytes = 2 << 20;  // bursts of a thousand messages, and to spare
  return role == loop::Role::logger && scenario.loop.mode == experiment::Mode::realtime &&
         transport.receive_buffer_bytes() < enough_bytes;
}

/// What the others cannot know: they only miss this process.
void tell_what_was_not_sent(const bus::UdpTransport& transport) {
  const bus::UdpStatistics statistics = transport.statistics();
  if (statistics.unsent == 0) return;
  diagnostics::log_warning(std::to_string(statistics.unsent) + " messages could not be sent (" +
                           std::strerror(statistics.refusal) + "); `tachless doctor` looks closer");
}

void report(Statistics& statistics, const std::optional<bus::UdpTransport>& transport,
            const std::optional<bus::Authenticated>& authenticated, const ProcessOptions& options) {
  if (transport) tell_what_was_not_sent(*transport);
  if (authenticated) statistics.rejected.add(Discard::unauthenticated, authenticated->dropped());
  if (options.stats_path) write_statistics(statistics, *options.stats_path);
}

}  // namespace

diagnostics::ExitCode run_role(loop::Role role, const ProcessOptions& options, const Part& part) {
  const std::atomic<bool>& interrupted = process::catch_interruptions();
  process::survive_file_size_limit();
  Statistics early;  // of a process that does not get as far as a session
  early.role = role;
  std::optional<bus::UdpTransport> transport;
  std::optional<bus::ChannelwiseTransport> channelwise;
  std::optional<bus::Authenticated> authenticated;
  std::optional<Session> session;
  try {
    const experiment::Scenario scenario =
        experiment::load_scenario(options.scenario_path, options.overrides);
    if (options.resume && scenario.loop.mode != experiment::Mode::lockstep) {
      throw diagnostics::Failure(
          diagnostics::ExitCode::bad_usage,
          "--resume: a realtime run does not wait for another controller: the robot is "
          "stopped; start a new run");
    }
    join(transport, options.lcm_url);
    bus::Transport* heard = &*transport;
    if (needs_more_buffers(role, scenario, *transport)) heard = &channelwise.emplace(*transport);
    if (options.key_path) {
      heard = &authenticated.emplace(*heard, read_key_file(*options.key_path));
    }
    session.emplace(scenario, *heard,
                    Session::Config{.role = role,
                                    .run_id = options.run_id,
                                    .wait_s = options.wait_s,
                                    .interrupted = &interrupted,
                                    .instance = 0,
                                    .authenticated = authenticated ? &*authenticated : nullptr,
                                    .resume = options.resume.has_value(),
                                    .follow = options.follow});
    if (scenario.loop.mode == experiment::Mode::realtime) request_real_time(role);
    session->play([&] { part(scenario, *heard, *session); });
  } catch (const diagnostics::Failure& failure) {
    Statistics& statistics = session ? session->statistics() : early;
    statistics.exit_code = failure.code();
    statistics.fault = failure.what();
    try {
      report(statistics, transport, authenticated, options);
    } catch (const diagnostics::Failure& second) {
      diagnostics::log_warning(second.what());
    }
    throw;
  }
  report(session->statistics(), transport, authenticated, options);
  return diagnostics::ExitCode::done;
}

}  // namespace tachless::node
