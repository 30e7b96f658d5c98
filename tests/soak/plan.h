#pragma once

// Which run each round of a soak makes, and what is done to it. Pure: nothing is started here.

#include <chrono>
#include <cstdint>
#include <string>

#include "loop/messages.h"

namespace tachless::soak {

/// What a round does to its run.
enum class Fault {
  none,           ///< lock-step, left alone
  hostile,        ///< lock-step, hostile datagrams without end
  loss,           ///< lock-step, the network loses packets
  kill,           ///< lock-step, a process is killed
  realtime,       ///< on the wall clock, left alone
  key,            ///< lock-step, on a bus with a key
  pause,          ///< lock-step, a process stands still for a while
  interrupt,      ///< lock-step, Ctrl-C
  restart,        ///< lock-step, the controller is killed and another takes over
  realtime_kill,  ///< on the wall clock, a process is killed
};
inline constexpr int num_faults = 10;

/// One round, all of which follows from its seed. Seeds in a row go through all faults.
struct Round {
  std::uint64_t seed = 0;
  Fault fault = Fault::none;
  std::string scenario;  ///< name of a file in scenarios/
  double moment = 0;     ///< of kill, pause and interrupt: share of the run's ticks before it
  int loss_percent = 0;
  loop::Role victim = loop::Role::plant;  ///< of kill and pause
  std::chrono::milliseconds pause{0};

  [[nodiscard]] bool realtime() const {
    return fault == Fault::realtime || fault == Fault::realtime_kill;
  }
};

Round plan_round(std::uint64_t seed);

/// "clean", "hostile": one word for tables and JSON.
std::string name_of(Fault fault);

/// "controller killed after 43 %": what the round does.
std::string describe(const Round& round);

}  // namespace tachless::soak
