#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "bus/authenticated.h"
#include "bus/transport.h"
#include "bus/truth/truth_wire.h"
#include "experiment/scenario.h"

namespace tachless::viewer {

/// Hears where a run's robot truly is. Only listens, and never waits on the socket: whoever sends
/// to a socket that a process waits on pays for waking it.
class TruthListener {
 public:
  /// @param run its id; 0: the first run that is heard
  /// @throw std::invalid_argument, std::system_error as bus::UdpTransport
  TruthListener(const bus::LcmUrl& url, const std::optional<bus::Key>& key,
                const experiment::Scenario& scenario, std::int64_t run);

  /// Hands over every pose that has arrived: simulated time [s] and link positions [rad; m]. The
  /// plant repeats itself: poses come twice and out of order.
  void drain(const std::function<void(double t_s, const robot::Vector& q)>& on_pose);

 private:
  void note_plant(const bus::Datagram& datagram);

  std::unique_ptr<bus::Transport> transport_;
  std::optional<bus::Authenticated> authenticated_;
  std::string truth_channel_;
  bus::Codec<loop::truth::PlantTruth> truth_codec_;
  bus::Codec<loop::Participant> participant_codec_;
  double period_s_;
  std::int64_t run_;
  loop::PerRole roster_{};  // of the session whose key is known
  loop::Stamp stamp_;
  loop::truth::PlantTruth truth_;
};

}  // namespace tachless::viewer
