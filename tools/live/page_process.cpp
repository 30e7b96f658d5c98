#include "live/page_process.h"

#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <limits>
#include <system_error>
#include <utility>

#include "base/child.h"
#include "base/failure.h"
#include "base/logging.h"
#include "base/this_process.h"
#include "bus/udp_transport.h"
#include "live/live_run.h"
#include "live/live_server.h"
#include "live/watch.h"
#include "report/report.h"

namespace tachless::live {
namespace {

using base::Clock;

constexpr rlim_t most_new_memory = 160'000'000;  // beyond the memory that the child begins with
constexpr rlim_t most_descriptors = 64;

/// Serves the runs of all robots on the bus until this process is killed.
[[noreturn]] void serve_runs(bus::UdpTransport& transport, LiveServer& server,
                             const RobotVisuals& visuals) {
  constexpr auto stretch = std::chrono::milliseconds(25);
  constexpr auto turn = std::chrono::milliseconds(1);
  struct Robot {
    LiveRun live;
    std::int64_t shown = 0;  ///< run
  };
  std::map<std::string, Robot, std::less<>> robots;  // by the channel of RUN_INFO
  const auto take = [&](const bus::Datagram& datagram) {
    if (!datagram.channel.ends_with(logger::run_info_suffix)) {
      for (auto& [channel, robot] : robots) robot.live.take(datagram);
      return;
    }
    auto own = robots.find(datagram.channel);
    if (own == robots.end() && robots.size() < LiveServer::most_robots) {
      own = robots.try_emplace(std::string(datagram.channel)).first;
    }
    if (own != robots.end()) own->second.live.take(datagram);
  };
  while (true) {
    for (const auto end = Clock::now() + stretch; Clock::now() < end;) {
      drain(transport, take);
      server.serve(std::min(end, Clock::now() + turn));
    }
    for (auto& [channel, robot] : robots) {
      const logger::RunDescription* const run = robot.live.run();
      if (run == nullptr) continue;
      if (std::exchange(robot.shown, run->run_id) != run->run_id) {
        const auto own = visuals.find(run->info.robot);
        server.begin(
            run->info.robot,
            report::live_page(*run, own == visuals.end() ? report::Visuals() : own->second));
      }
      if (std::string text = robot.live.stretch(); !text.empty()) {
        server.add(run->info.robot, std::move(text));
      }
    }
  }
}

/// Closes all descriptors but the standard ones and `kept`.
void close_others(int kept) {
  const auto own = static_cast<unsigned>(kept);
  if (own > STDERR_FILENO + 1) close_range(STDERR_FILENO + 1, own - 1, 0);
  close_range(own + 1, std::numeric_limits<unsigned>::max(), 0);
}

/// Returns the memory that this process can write [bytes].
rlim_t writable_memory() {
  std::ifstream file("/proc/self/statm");
  rlim_t size = 0, resident = 0, shared = 0, text = 0, library = 0, data = 0;
  file >> size >> resident >> shared >> text >> library >> data;
  return data * static_cast<rlim_t>(sysconf(_SC_PAGESIZE));
}

void limit(__rlimit_resource resource, rlim_t most) {
  rlimit own{};
  if (getrlimit(resource, &own) != 0) return;
  own.rlim_max = std::min(own.rlim_max, most);
  own.rlim_cur = std::min(own.rlim_cur, own.rlim_max);
  setrlimit(resource, &own);
}

/// Gives this process up to its work as a page: limits, least priority, no signals of its parent.
void confine(pid_t parent, const LiveServer& server) {
  setpgid(0, 0);  // Ctrl-C reaches the parent alone
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(0);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) std::signal(signal, SIG_DFL);
  std::signal(SIGPIPE, SIG_IGN);
  close_others(server.descriptor());
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_NOFILE, most_descriptors);
#ifndef __SANITIZE_ADDRESS__  // its own memory counts
  limit(RLIMIT_DATA, writable_memory() + most_new_memory);
#endif
  prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  base::set_low_priority();
}

}  // namespace

PageProcess::PageProcess(const bus::LcmUrl& url, const RobotVisuals& visuals, int port) {
  LiveServer server(port);
  url_ = server.url();
  try {
    const bus::UdpTransport available(url);
  } catch (const std::system_error& error) {
    throw base::bad_usage(error.what());
  }
  std::signal(SIGCHLD, SIG_DFL);  // if it were ignored, no end could be noticed
  const pid_t parent = getpid();
  child_ = fork();
  if (child_ < 0) throw std::system_error(errno, std::generic_category(), "fork");
  if (child_ > 0) return;
  try {
    confine(parent, server);
    bus::UdpTransport transport(url);
    transport.subscribe_all();
    serve_runs(transport, server, visuals);
  } catch (const std::exception& error) {
    base::log_warning("the live page has ended: {}", error.what());
  }
  _exit(1);
}

PageProcess::~PageProcess() {
  if (child_ < 0) return;
  kill(child_, SIGKILL);
  while (waitpid(child_, nullptr, 0) < 0 && errno == EINTR) continue;
}

bool PageProcess::running() {
  if (child_ >= 0 && waitpid(child_, nullptr, WNOHANG) == child_) child_ = -1;
  return child_ >= 0;
}

void PageProcess::show() const {
  base::log_info("watch the run at {}", url_);
  const char* const display = std::getenv("DISPLAY");
  const auto opener = base::find_program("xdg-open");
  if (display == nullptr || *display == '\0' || !opener) return;
  // setsid: the browser stays when the run has ended. /dev/null: `base::run` waits for the end of
  // the output.
  base::run(
      {"/bin/sh", "-c", "exec setsid --fork \"$@\" >/dev/null 2>&1", "sh", opener->string(), url_});
}

}  // namespace tachless::live
