#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "bus/transport.h"
#include "logger/run_log.h"

namespace tachless::live {

/// A robot's run as its messages on the bus show it, for a page that draws the run while it lasts.
/// It keeps each signal's lowest and highest value since the last stretch. It does not verify the
/// messages. Its memory does not grow with the run.
class LiveRun {
 public:
  LiveRun();
  ~LiveRun();

  /// Takes a message of any channel. RUN_INFO of another run begins that run.
  void take(const bus::Datagram& datagram);

  /// Returns the run; null until a usable RUN_INFO has come.
  [[nodiscard]] const logger::RunDescription* run() const;

  /// Returns the messages since the last call as JSON, or an empty text if none has come:
  /// {"run": id, "number": of this stretch, "t": newest time [s],
  ///  "curves": {"q": [[t, y, t, y] of each joint], …}, "rate": ticks per second,
  ///  "jitter_us": standard deviation of the ticks' intervals, "missed": commands so far,
  ///  "saturated": [joints, from 0], "events": [texts]}.
  /// The curves are q, q_ref, theta, |e|, τ, and the law's signals by name. If TRUTH is on the bus,
  /// it gives link angles and torques, as in a report; else they are measured and commanded. The
  /// first stretch's number is the time [us] of the RUN_INFO, and numbers grow by one. A program
  /// started later has greater numbers.
  std::string stretch();

 private:
  struct Run;
  std::unique_ptr<Run> run_;
  std::int64_t next_read_ns_ = 0;  ///< time at which the next RUN_INFO may be read
};

}  // namespace tachless::live
