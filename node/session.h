#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "bus/transport.h"
#include "bus/wire.h"
#include "diagnostics/failure.h"
#include "experiment/scenario.h"
#include "loop/clock.h"
#include "node/statistics.h"
#include "protocol/lockstep/message_ring.h"

/// What the four programs' nodes are made of: a session with the run, and the loop that waits for
/// messages. Knows no message but the participants'.
namespace tachless::node {

/// One process's part in a run, as its node uses it: `join`, then in a loop `poll`, `handle` and
/// `accept` for every datagram, until `finished`, then `leave`. Implemented by Link (a run under
/// way) and Playback (a recorded one).
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

/// A controller's part in a recorded run that lcm-logplayer plays back: it answers the questions of
/// that run at once. Nobody is met and nothing is announced; the run is over with its last tick.
class Playback final : public Session {
 public:
  /// @param wait_s for the first message; 0 = unlimited
  Playback(const experiment::Scenario& scenario, std::int64_t run, double wait_s,
           const std::atomic<bool>* interrupted);

  void join(const loop::LawInfo& law, const Handler& other) override;
  [[nodiscard]] std::int64_t run() const override { return run_; }
  void started(loop::Clock::time_point now) override {
    if (tick_ < 0) note_start(now);
  }
  void poll(loop::Clock::time_point now) override;
  [[nodiscard]] loop::Clock::time_point next_poll() const override { return next_poll_; }
  bool handle(const bus::Datagram& /*datagram*/) override { return false; }
  void handle_pending() override { poll(loop::Clock::now()); }
  void progressed(std::int64_t tick, double error_norm) override;
  void complete() override {}  // the last tick is the end
  [[nodiscard]] bool finished() const override { return tick_ >= last_tick_; }
  void leave() override { note_end(loop::Clock::now()); }
  [[nodiscard]] std::int64_t tick_of(loop::Role /*role*/) const override { return -1; }
  [[nodiscard]] std::string describe(loop::Role role) const override;
  [[nodiscard]] bool knows(std::string_view /*sender*/) const override { return false; }

 private:
  void announce_fault(const diagnostics::Failure& /*failure*/) override {}

  std::int64_t run_;
  std::int64_t last_tick_;
  double wait_s_;
  double give_up_s_;
  std::int64_t tick_ = -1;  ///< newest one answered
  loop::Clock::time_point progress_at_;
  loop::Clock::time_point next_poll_;
};

/// What the loops of the four programs have in common: waits for a datagram, hands it to the
/// session first, then to whoever handles its channel; counts what became of it, and fails when two
/// processes have one role. Knows no message type and no tick.
class Loop {
 public:
  using Time = loop::Clock::time_point;
  using Handler = Session::Handler;

  Loop(bus::Transport& transport, Session& session) : transport_(transport), session_(session) {}

  /// Subscribes to `channel`; its messages go to `handler` from now on.
  void on(const std::string& channel, Handler handler);
  /// The session's own messages go to `handler`, too, after the session has seen them.
  void on_session(Handler handler) { session_handler_ = std::move(handler); }

  /// Done once each turn; says when the next turn is due at the latest.
  using Turn = std::function<Time(Time now)>;
  /// Polls the session and handles what comes until `done`.
  void run_until(const std::function<bool()>& done, const Turn& turn = {});
  /// The same until the session's run is over.
  /// @param complete whether all ticks of this process are there: before that nobody is believed
  /// who says that it is over
  void run_until_finished(const std::function<bool(Time now)>& complete, const Turn& turn = {});

  /// Handles one datagram, if one comes before the deadline. @return whether one did
  bool receive(Time deadline);
  void handle(const bus::Datagram& datagram);

  /// Counts what became of a message for `tick` that `sender` has sent.
  /// @param first_sender () -> who sent the message that it conflicts with
  /// @throw Failure(protocol_violated) when it conflicts: two processes have the role `from`.
  template <class FirstSender>
  void count(protocol::lockstep::Verdict verdict, loop::Role from, const bus::Datagram& datagram,
             std::int64_t tick, FirstSender first_sender) {
    if (verdict == protocol::lockstep::Verdict::conflicting) {
      throw two_of(from, datagram, tick, first_sender());
    }
    count(verdict);
  }
  /// The same for a message that cannot conflict.
  void count(protocol::lockstep::Verdict verdict);

 private:
  [[nodiscard]] diagnostics::Failure two_of(loop::Role role, const bus::Datagram& second,
                                            std::int64_t tick, std::string_view first) const;

  bus::Transport& transport_;
  Session& session_;
  Handler session_handler_;
  // A deque: a handler may add another one while it runs.
  std::deque<std::pair<std::string, Handler>> handlers_;
};

}  // namespace tachless::node
