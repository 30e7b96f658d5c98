#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <iostream>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <system_error>

#include "bus/udp_transport.h"
#include "launch/verb.h"
#include "monitor/bus_monitor.h"
#include "node/options.h"
#include "process/interruption.h"
#include "process/step_aside.h"

namespace tachless::launch::verb {
namespace {

using loop::Clock;
using namespace std::chrono_literals;

constexpr double once_s = 2;
constexpr auto redraw_period = 1s;
constexpr auto shortest_nap = 1ms;
constexpr auto longest_nap = 50ms;

struct Options {
  bool once = false;
  bool json = false;
  double seconds = 0;  // 0: --once: `once_s`, else until interrupted
  std::string lcm_url = node::default_lcm_url;
};

bus::UdpTransport join(const std::string& lcm_url) {
  try {
    return bus::UdpTransport(node::parse_lcm_url(lcm_url));
  } catch (const std::system_error& error) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage, error.what());
  }
}

/// Reads everything that is on the bus. It does not wait on the socket: whoever sends to a socket
/// that a process waits on pays for waking it. Instead it sleeps for as long as the socket's buffer
/// surely holds what comes, and then takes it all.
class Listener {
 public:
  Listener(bus::UdpTransport& transport, monitor::BusMonitor& monitor,
           const std::atomic<bool>& interrupted)
      : transport_(transport), monitor_(monitor), interrupted_(interrupted) {}

  void listen_until(Clock::time_point end) {
    while (!interrupted_ && Clock::now() < end) {
      const Clock::time_point begin = Clock::now();
      const std::uint64_t count = drain(end);
      adapt(count, begin);
      if (!interrupted_) sleep_until(std::min(end, Clock::now() + nap_));
    }
    // What had arrived by now counts, however late this process gets to read it.
    drain_what_came_before(std::chrono::system_clock::now());
  }

 private:
  std::uint64_t drain(Clock::time_point end) {
    constexpr std::uint64_t between_looks = 256;
    std::uint64_t count = 0;
    while (const auto raw = transport_.receive_raw(Clock::time_point::min())) {
      monitor_.take(*raw);
      bytes_ += raw->datagram.payload.size();
      if (++count % between_looks == 0 && (interrupted_ || Clock::now() >= end)) break;
    }
    return count;
  }

  void drain_what_came_before(std::chrono::system_clock::time_point end) {
    const auto end_ns =
        std::chrono::duration_cast<std::chrono::nanoseconds>(end.time_since_epoch()).count();
    while (const auto raw = transport_.receive_raw(Clock::time_point::min())) {
      monitor_.take(*raw);
      if (raw->received_ns >= end_ns) break;
    }
  }

  /// A quarter of the buffer has to hold what comes in one nap.
  void adapt(std::uint64_t count, Clock::time_point begin) {
    constexpr double kernel_bytes_per_datagram = 1024;  // bookkeeping, at least doubled
    const double since_s = std::chrono::duration<double>(begin - last_drain_).count();
    last_drain_ = begin;
    const double bytes = static_cast<double>(std::exchange(bytes_, 0)) +
                         kernel_bytes_per_datagram * static_cast<double>(count);
    const double held_s = 0.25 * transport_.receive_buffer_bytes() * since_s / std::max(bytes, 1.0);
    const Clock::duration held = std::chrono::duration_cast<Clock::duration>(
        std::chrono::duration<double>(std::min(held_s, 1.0)));
    nap_ = std::clamp<Clock::duration>(std::min(held, 2 * nap_), shortest_nap, longest_nap);
  }

  static void sleep_until(Clock::time_point end) {
    const auto left =
        std::max(std::chrono::nanoseconds(end - Clock::now()), std::chrono::nanoseconds(0));
    const timespec time{left.count() / 1'000'000'000, left.count() % 1'000'000'000};
    ppoll(nullptr, 0, &time, nullptr);  // a signal ends it
  }

  bus::UdpTransport& transport_;
  monitor::BusMonitor& monitor_;
  const std::atomic<bool>& interrupted_;
  Clock::duration nap_ = shortest_nap;
  Clock::time_point last_drain_ = Clock::now();
  std::uint64_t bytes_ = 0;
};

/// Where the table goes: over the last one on a terminal, one after the other elsewhere.
class Screen {
 public:
  Screen() {
    if (terminal_) std::cout << "\033[?25l" << std::flush;  // no cursor
  }
  Screen(const Screen&) = delete;
  Screen& operator=(const Screen&) = delete;
  ~Screen() {
    if (terminal_) std::cout << "\033[?25h" << std::flush;
  }

  void show(monitor::BusMonitor& monitor) {
    winsize size{};
    if (!terminal_ || ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0) size = {};
    // The last row stays free, or the terminal would scroll.
    const std::size_t rows = size.ws_row > 3 ? size.ws_row - 1U : 0U;
    const auto lines = monitor.table(size.ws_col, rows);
    std::string text;
    if (terminal_ && height_ > 0) text = "\033[" + std::to_string(height_) + "A\r";
    for (const std::string& line : lines) text += line + (terminal_ ? "\033[K\n" : "\n");
    if (terminal_) text += "\033[J";
    std::cout << text << std::flush;
    height_ = lines.size();
  }

 private:
  bool terminal_ = isatty(STDOUT_FILENO) == 1;
  std::size_t height_ = 0;
};

double listen(Listener& listener, Clock::time_point begin, Clock::time_point end) {
  listener.listen_until(end);
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

nlohmann::ordered_json with_url(const std::string& url, monitor::BusMonitor& monitor) {
  nlohmann::ordered_json result = {{"lcm_url", url}};
  result.update(monitor.to_json());
  return result;
}

diagnostics::ExitCode watch_bus(const Options& options) {
  const std::atomic<bool>& interrupted = process::catch_interruptions();
  bus::UdpTransport transport = join(options.lcm_url);
  const std::string url = transport.url().text();
  process::step_aside(getpid());
  transport.subscribe_all();
  monitor::BusMonitor monitor;
  Listener listener(transport, monitor, interrupted);
  const Clock::time_point begin = Clock::now();
  const double seconds = options.once && options.seconds == 0 ? once_s : options.seconds;
  const Clock::time_point end = seconds == 0 ? Clock::time_point::max()
                                             : begin + std::chrono::duration_cast<Clock::duration>(
                                                           std::chrono::duration<double>(seconds));
  if (options.once) {
    monitor.end_stretch(listen(listener, begin, end));
    monitor.set_statistics(transport.statistics());
    if (options.json) {
      std::cout << with_url(url, monitor).dump(2) << "\n";
    } else {
      std::cout << url << "\n";
      for (const std::string& line : monitor.table()) std::cout << line << "\n";
    }
    return diagnostics::ExitCode::done;
  }
  std::optional<Screen> screen;
  if (!options.json) {
    std::cout << url << ", Ctrl-C ends\n" << std::flush;
    screen.emplace();
  }
  Clock::time_point stretch = begin;
  while (!interrupted && Clock::now() < end && std::cout) {
    monitor.end_stretch(listen(listener, stretch, std::min(end, stretch + redraw_period)));
    stretch = Clock::now();
    monitor.set_statistics(transport.statistics());
    if (screen) {
      screen->show(monitor);
    } else {
      std::cout << with_url(url, monitor).dump() << "\n" << std::flush;
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
