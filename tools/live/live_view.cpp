#include "live/live_view.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <map>
#include <string>
#include <utility>

#include "base/child.h"
#include "base/logging.h"
#include "base/this_process.h"
#include "live/live_run.h"
#include "live/watch.h"
#include "report/report.h"

namespace tachless::live {

using base::Clock;

void show_live(bus::UdpTransport& transport, LiveServer& server, Clock::time_point end,
               const std::atomic<bool>& interrupted, const RobotVisuals& visuals) {
  constexpr std::size_t most_robots = 16;
  constexpr auto stretch = std::chrono::milliseconds(25);
  struct Robot {
    live::LiveRun live;
    std::int64_t shown = 0;  ///< run
  };
  std::map<std::string, Robot, std::less<>> robots;  // by the channel of RUN_INFO
  const auto take = [&](const bus::Datagram& datagram) {
    if (!datagram.channel.ends_with(logger::run_info_suffix)) {
      for (auto& [channel, robot] : robots) robot.live.take(datagram);
      return;
    }
    auto own = robots.find(datagram.channel);
    if (own == robots.end() && robots.size() < most_robots) {
      own = robots.try_emplace(std::string(datagram.channel)).first;
    }
    if (own != robots.end()) own->second.live.take(datagram);
  };
  while (!interrupted && Clock::now() < end) {
    live::listen(transport, take, std::min(end, Clock::now() + stretch), interrupted);
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

LiveView::LiveView(const bus::LcmUrl& url, RobotVisuals visuals)
    : transport_(url), visuals_(std::move(visuals)) {
  transport_.subscribe_all();
  base::log_info("watch the run at {}", server_.url());
  const char* const display = std::getenv("DISPLAY");
  const auto opener = base::find_program("xdg-open");
  if (display != nullptr && *display != '\0' && opener) {
    // In a session of its own: the browser stays when the run has ended. Without an output of ours,
    // whose end is waited for.
    base::run({"/bin/sh", "-c", "exec setsid --fork \"$@\" >/dev/null 2>&1", "sh", opener->string(),
               server_.url()});
  }
  thread_ = std::thread([this] {
    base::leave_signals_to_others();
    base::set_low_priority();
    show_live(transport_, server_, Clock::time_point::max(), over_, visuals_);
  });
}

LiveView::~LiveView() {
  over_ = true;
  thread_.join();
}

}  // namespace tachless::live
