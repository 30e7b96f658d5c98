#include "node/run_role.h"

#include <fmt/core.h>

#include <chrono>
#include <cstring>
#include <optional>
#include <system_error>

#include "bus/channelwise_transport.h"
#include "bus/tcpq_transport.h"
#include "bus/udp_transport.h"
#include "diagnostics/logging.h"
#include "node/key_file.h"
#include "node/options.h"
#include "node/real_time.h"
#include "process/this_process.h"
#include "protocol/lockstep/log_window.h"

namespace tachless::node {
namespace {

using namespace std::chrono_literals;
using diagnostics::ExitCode;
using diagnostics::Failure;

/// The bus that a process listens and speaks on.
class Bus {
 public:
  void open(const ProcessOptions& options, loop::Role role, const experiment::Scenario& scenario) {
    const bus::LcmUrl where = parse_lcm_url(options.lcm_url);
    try {
      if (where.is_tcp()) {
        tcp_.emplace(where);
        diagnostics::log_detail("bus " + where.text());
        return;
      }
      udp_.emplace(where);
    } catch (const std::system_error& problem) {
      throw diagnostics::bad_usage(
          where.is_tcp()
              ? fmt::format("{}; start it with: {}", problem.what(), bus::server_command(where))
              : fmt::format("{}: {}", options.lcm_url, problem.what()));
    }
    diagnostics::log_detail("bus {}, receive buffer {} bytes", where.text(),
                            udp_->receive_buffer_bytes());
    if (options.spin) udp_->spin();
    if (role != loop::Role::logger) return;
    if (scenario.loop.mode == experiment::Mode::lockstep) {
      // The plant waits for nothing that the logger does, until the window is full.
      udp_->collect(loop::num_slots * protocol::lockstep::LogWindow::ack_interval, 1ms);
      return;
    }
    // Nothing is repeated for a realtime logger: what its buffers do not hold while it waits for a
    // processor is lost.
    constexpr int enough_bytes = 2 << 20;  // bursts of a thousand messages, and to spare
    if (udp_->receive_buffer_bytes() < enough_bytes) channelwise_.emplace(*udp_);
  }
  bus::Transport& transport() {
    if (tcp_) return *tcp_;
    return channelwise_ ? static_cast<bus::Transport&>(*channelwise_) : *udp_;
  }
  /// The others cannot know: they only miss this process.
  void tell_what_was_not_sent() const {
    if (!udp_ || udp_->statistics().unsent == 0) return;
    diagnostics::log_warning("{} messages could not be sent ({}); `tachless doctor` looks closer",
                             udp_->statistics().unsent, std::strerror(udp_->statistics().refusal));
  }

 private:
  std::optional<bus::UdpTransport> udp_;
  std::optional<bus::TcpqTransport> tcp_;
  std::optional<bus::ChannelwiseTransport> channelwise_;
};

Link::Config link_config(loop::Role role, const ProcessOptions& options,
                         const std::atomic<bool>& interrupted) {
  Link::Config config;
  config.role = role;
  config.run_id = options.plant.run_id;
  config.wait_s = options.wait_s;
  config.interrupted = &interrupted;
  if (options.key_path) config.key = read_key_file(*options.key_path);
  diagnostics::log_detail(
      config.key ? fmt::format("messages have the tag of the key in {}", options.key_path->string())
                 : "messages have no tag: no --key-file");
  config.resume = options.controller.resume.has_value();
  return config;
}

}  // namespace

ExitCode run_role(loop::Role role, const ProcessOptions& options, const RoleMain& main,
                  const PlaybackMain& playback) {
  const std::atomic<bool>& interrupted = process::catch_interruptions();
  process::survive_file_size_limit();
  Bus bus;
  std::optional<Link> link;
  std::optional<Playback> played;
  Statistics early(role);  // of a process that does not get as far as a session
  const auto statistics = [&]() -> Statistics& {
    return link ? link->statistics() : played ? played->statistics() : early;
  };
  const auto report = [&] {
    bus.tell_what_was_not_sent();
    if (link) statistics().rejected.add(Discard::unauthenticated, link->unauthenticated());
    if (options.stats_path) write_statistics(statistics(), *options.stats_path);
  };
  try {
    const experiment::Scenario scenario =
        experiment::load_scenario(find_scenario(options.scenario_path), options.overrides);
    const bool realtime = scenario.loop.mode == experiment::Mode::realtime;
    if (options.controller.resume && realtime) {
      throw diagnostics::bad_usage(
          "--resume: a realtime run does not wait for another controller: the robot is stopped; "
          "start a new run");
    }
    bus.open(options, role, scenario);
    if (options.controller.follow) {
      played.emplace(scenario, Playback::Config{.run = *options.controller.follow,
                                                .wait_s = options.wait_s,
                                                .interrupted = &interrupted});
    } else {
      link.emplace(scenario, bus.transport(), link_config(role, options, interrupted));
    }
    if (realtime) request_real_time(role);
    if (played) {
      played->guard([&] { playback(scenario, bus.transport(), *played); });
    } else {
      link->guard([&] { main(scenario, link->transport(), *link); });
    }
  } catch (const Failure& failure) {
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
