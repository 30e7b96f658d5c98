#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "bus/transport.h"
#include "logger/run_log.h"

namespace tachless::live {

/// A robot's run as its messages on the bus show it, for a page that draws it while it goes on:
/// of each signal the lowest and the highest value since the last stretch. What it takes is not
/// verified. Memory does not grow with the run.
class LiveRun {
 public:
  LiveRun();
  ~LiveRun();

  /// A message of any channel. RUN_INFO of another run begins that run.
  void take(const bus::Datagram& datagram);

  /// The run; null until a usable RUN_INFO has come.
  [[nodiscard]] const logger::RunDescription* run() const;

  /// What has come since the last call, as JSON; empty when nothing has:
  /// {"run": id, "number": of this stretch, "t": newest time [s],
  ///  "curves": {"q": [[t, y, t, y] of each joint], …}, "rate": ticks per second,
  ///  "jitter_us": standard deviation of the ticks' intervals, "missed": commands so far,
  ///  "saturated": [joints, from 0], "events": [texts]}.
  /// Curves: q, q_ref, theta, |e|, τ, and the law's signals by name. Link angles and torques are
  /// TRUTH's where it is on the bus, as in a report; else as measured and commanded. Numbers grow
  /// by one, from the time [us] of the RUN_INFO: a program started later has greater ones.
  std::string stretch();

 private:
  struct Run;
  std::unique_ptr<Run> run_;
  std::int64_t next_read_ns_ = 0;  ///< when the next RUN_INFO may be read
};

}  // namespace tachless::live
