#pragma once

#include <sys/types.h>
#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "bus/udp_transport.h"
#include "bus/wire.h"
#include "tests/soak/hostile_traffic.h"
#include "tests/soak/spec.h"

namespace tachless::soak {

/// Resident memory of one process in one round [KiB].
struct Memory {
  std::int64_t early = 0;  ///< once a tenth of the run was over
  std::int64_t peak = 0;   ///< from then on
};

/// Follows a run from outside: its processes under /proc, its ticks on the bus. It neither changes
/// the run nor judges it.
class Observer {
 public:
  using Clock = std::chrono::steady_clock;

  /// @param traffic to be given the run's messages as samples; null: none is sent
  Observer(const Spec& spec, HostileTraffic* traffic);

  void look_at_processes();
  /// Reads all datagrams that have arrived.
  void listen();

  [[nodiscard]] std::int64_t tick() const { return tick_; }  ///< newest seen; -1: none
  [[nodiscard]] bool saw_last_tick() const { return last_; }
  /// `tachless run`; nothing before it is started.
  [[nodiscard]] std::optional<pid_t> launcher() const { return launcher_; }
  [[nodiscard]] std::optional<pid_t> process_of(loop::Role role) const;
  /// Since when none of the four processes exists; nothing while there are some, or none yet.
  [[nodiscard]] std::optional<Clock::time_point> gone_since() const { return gone_since_; }
  /// By program. Without processes that took over for another: they have read the log.
  [[nodiscard]] const std::map<std::string, Memory>& memory() const { return memory_; }

 private:
  void take(const bus::Datagram& datagram);

  const Spec& spec_;
  HostileTraffic* traffic_;
  std::string tick_channel_;
  bus::Codec<loop::Tick> codec_;
  bus::UdpTransport bus_;
  std::int64_t tick_ = -1;
  bool last_ = false;
  std::optional<pid_t> launcher_;
  std::map<std::string, pid_t> processes_, first_pids_;
  std::optional<Clock::time_point> gone_since_;
  std::map<std::string, Memory> memory_;
};

}  // namespace tachless::soak
