#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>

#include "bus/transport.h"
#include "diagnostics/json_text.h"
#include "launch/verb.h"
#include "monitor/bus_monitor.h"
#include "monitor/watch.h"
#include "node/options.h"
#include "process/interruption.h"
#include "process/step_aside.h"

namespace tachless::launch::verb {
namespace {

using loop::Clock;

constexpr double once_s = 2;
constexpr std::chrono::seconds redraw_period{1};

struct Options {
  bool once = false;
  bool json = false;
  double seconds = 0;  // 0: --once: `once_s`, else until interrupted
  std::string lcm_url = node::default_lcm_url;
};

std::unique_ptr<bus::MonitoredBus> join(const bus::LcmUrl& url) {
  try {
    return bus::open_bus(url);
  } catch (const std::system_error& error) {
    throw diagnostics::bad_usage(error.what());
  }
}

std::string json_text(const std::string& url, monitor::BusMonitor& monitor, int indent = -1) {
  nlohmann::ordered_json result = {{"lcm_url", url}};
  result.update(monitor.to_json());
  return diagnostics::json_text(result, indent) + "\n";
}

diagnostics::ExitCode watch_bus(const Options& options) {
  const std::atomic<bool>& interrupted = process::catch_interruptions();
  const bus::LcmUrl where = node::parse_lcm_url(options.lcm_url);
  const std::string url = where.text();
  const auto transport = join(where);
  process::step_aside(getpid());
  transport->subscribe_all();
  monitor::BusMonitor monitor;
  monitor::Listener listener(*transport, monitor, interrupted);
  Clock::time_point begin = Clock::now();
  const double seconds = options.once && options.seconds == 0 ? once_s : options.seconds;
  const Clock::time_point end = seconds == 0 ? Clock::time_point::max()
                                             : begin + std::chrono::duration_cast<Clock::duration>(
                                                           std::chrono::duration<double>(seconds));
  if (options.once) {
    listener.listen(begin, end);
    if (options.json) {
      std::cout << json_text(url, monitor, 2);
    } else {
      std::cout << url << "\n";
      for (const std::string& line : monitor.table()) std::cout << line << "\n";
    }
    return diagnostics::ExitCode::done;
  }
  std::optional<monitor::TableScreen> screen;
  if (!options.json) {
    std::cout << url << ", q or Ctrl-C ends\n" << std::flush;
    screen.emplace();
  }
  while (!interrupted && Clock::now() < end && std::cout && !(screen && screen->quit_wanted())) {
    listener.listen(begin, std::min(end, begin + redraw_period));
    begin = Clock::now();
    if (screen) {
      screen->show(monitor);
    } else {
      std::cout << json_text(url, monitor) << std::flush;
    }
  }
  return diagnostics::ExitCode::done;
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  command.add_flag("--once", options->once, "Listen, print what was heard, and end");
  command
      .add_option("--seconds", options->seconds,
                  "How long to listen [s]; default: --once 2, else until Ctrl-C")
      ->check(CLI::Range(0.01, 1e6));
  command.add_flag("--json", options->json, "As JSON; without --once one line per second");
  node::add_lcm_url(command, options->lcm_url);
  return [options] { return watch_bus(*options); };
}

}  // namespace

extern const Verb watch;
const Verb watch = {"watch", "What is on the bus: channels, rates, jitter, gaps, newest values",
                    "  tachless watch\n"
                    "  tachless watch --once --seconds 5\n"
                    "  tachless watch --once --json --lcm-url 'udpm://239.255.76.67:7700?ttl=0'",
                    declare};

}  // namespace tachless::launch::verb
