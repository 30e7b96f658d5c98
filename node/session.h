#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "bus/transport.h"
#include "bus/wire.h"
#include "diagnostics/failure.h"
#include "loop/clock.h"
#include "node/statistics.h"

namespace tachless::node {

/// One process's part in a run, as its node uses it: `join`, then in a loop `poll`, `handle` and
/// `accept` for every datagram, until `finished`, then `leave`. Implemented by Link (a run under
/// way) and Playback (a recorded one). Knows no message but the participants'.
class Session {
 public:
  using Handler = std::function<void(const bus::Datagram&)>;

  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;
  virtual ~Session() = default;

  /// Runs `main` (the node's whole life). A Failure that leaves it, or any other exception, is
  /// noted in the statistics and told to the others before it goes on.
  void guard(const std::function<void()>& main);

  /// Waits until the run is known (plant: until all are ready). `law`: controller only. `other` is
  /// given what comes on the node's own channels meanwhile.
  /// @throw Failure: see `poll`; refused by or refusing another; nobody came within the wait.
  virtual void join(const loop::LawInfo& law, const Handler& other) = 0;
  [[nodiscard]] virtual std::int64_t run() const = 0;

  /// The first message of the run has been sent or accepted.
  virtual void started(loop::Clock::time_point now) = 0;

  /// To be called at the latest at `next_poll`: announcements, faults, silence, interruption.
  /// @throw Failure(interrupted), Failure(peer_lost, protocol_violated or protective_stop) for
  /// another's fault, naming it; Failure(peer_lost) when a playback stops before its end.
  virtual void poll(loop::Clock::time_point now) = 0;
  [[nodiscard]] virtual loop::Clock::time_point next_poll() const = 0;

  /// Whether the datagram was the session's own.
  virtual bool handle(const bus::Datagram& datagram) = 0;
  /// Handles what has come already, and polls: for a process that computes for long. Messages on
  /// other channels are lost.
  virtual void handle_pending() = 0;

  /// Whether the message is sound and of this run; counts it if not, and leaves `stamp` and `value`
  /// as they are or (another run's) as they came.
  template <class Value>
  bool accept(const bus::Codec<Value>& codec, const bus::Datagram& datagram, loop::Stamp& stamp,
              Value& value) {
    return accept(codec.decode(datagram.payload, stamp, value), stamp);
  }
  /// The same for a message that has been decoded already.
  bool accept(bus::Rejection rejection, const loop::Stamp& stamp);

  /// Newest tick handled, and (controller) the norm of its position error.
  virtual void progressed(std::int64_t tick, double error_norm = 0) = 0;
  /// All ticks of this process are there: only now is it believed that the plant has finished.
  virtual void complete() = 0;
  /// The run is over: the plant has finished.
  [[nodiscard]] virtual bool finished() const = 0;
  /// This process's part is done: tells the others.
  virtual void leave() = 0;

  /// Newest tick that the role's holder has announced; -1 before.
  [[nodiscard]] virtual std::int64_t tick_of(loop::Role role) const = 0;
  /// "the controller (process 123 on host arm-1, 10.0.0.2:4123)"
  [[nodiscard]] virtual std::string describe(loop::Role role) const = 0;
  /// Whether another process of this scenario sends from that address.
  [[nodiscard]] virtual bool knows(std::string_view sender) const = 0;

  Statistics& statistics() { return statistics_; }

 protected:
  /// @param interrupted set when the user wants the process to end; may be null
  Session(loop::Role role, const std::atomic<bool>* interrupted)
      : statistics_(role), interrupted_(interrupted) {}

  void note_start(loop::Clock::time_point now) { started_at_ = now; }
  void note_end(loop::Clock::time_point now);
  void throw_if_interrupted() const;

 private:
  /// Tells the others that this process ends with `failure`.
  virtual void announce_fault(const diagnostics::Failure& failure) = 0;
  void fail(const diagnostics::Failure& failure);

  Statistics statistics_;
  const std::atomic<bool>* interrupted_;
  loop::Clock::time_point started_at_;
};

}  // namespace tachless::node
