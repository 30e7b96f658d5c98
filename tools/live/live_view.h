#pragma once

#include <atomic>
#include <map>
#include <string>
#include <thread>

#include "base/clock.h"
#include "bus/udp_transport.h"
#include "live/live_server.h"
#include "report/visuals.h"

namespace tachless::live {

using RobotVisuals = std::map<std::string, report::Visuals>;

/// Shows through `server` the runs of all robots whose messages come, until `end` or an
/// interruption. @param transport receives all channels  @param visuals of robots by name
void show_live(bus::UdpTransport& transport, LiveServer& server, base::Clock::time_point end,
               const std::atomic<bool>& interrupted, const RobotVisuals& visuals = {});

/// That, beside a run, in a thread of the least priority: prints the address, and opens it in the
/// desktop's browser where there is one.
class LiveView {
 public:
  /// @throw base::Failure(bad_usage) as LiveServer
  LiveView(const bus::LcmUrl& url, RobotVisuals visuals);
  LiveView(const LiveView&) = delete;
  LiveView& operator=(const LiveView&) = delete;
  ~LiveView();

 private:
  bus::UdpTransport transport_;
  LiveServer server_{0};
  RobotVisuals visuals_;
  std::atomic<bool> over_ = false;
  std::thread thread_;
};

}  // namespace tachless::live
