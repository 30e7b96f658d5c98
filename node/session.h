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

#include "bus/authenticated.h"
#include "bus/wire.h"
#include "diagnostics/failure.h"
#include "experiment/scenario.h"
#include "loop/clock.h"
#include "node/statistics.h"
#include "protocol/lockstep/message_ring.h"

/// What the four programs' nodes are made of: their part in a run, with the loop that waits for
/// messages. Knows no message but the participants', and no tick.
namespace tachless::node {

/// One process's part in a run, as its node uses it: `on` for each channel, `join`,
/// `run_until_finished`, then `leave`. A datagram is the session's own or goes to whoever handles
/// its channel, who has it `accept`ed and says by `count` what became of it. Implemented by Link (a
/// run under way) and Playback (a recorded one).
class Session {
 public:
  using Time = loop::Clock::time_point;
  using Handler = std::function<void(const bus::Datagram&)>;

  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;
  virtual ~Session() = default;

  /// What the node's own messages are sent by.
  bus::Transport& transport() { return transport_; }
  /// Subscribes to `channel`; its messages go to `handler` from now on, by `receive` and
  /// `run_until` alone.
  void on(const std::string& channel, Handler handler);
  /// Announcements that are a member's own (protocol::Membership::handle) go to `handler`, too,
  /// after the session has handled them.
  void on_session(Handler handler) { session_handler_ = std::move(handler); }

  /// Runs `main` (the node's whole life). A Failure that leaves it, or any other exception, is
  /// noted in the statistics and told to the others before it goes on.
  void guard(const std::function<void()>& main);

  /// Waits until the run is known (plant: until all are ready). `law`: controller only. `other` is
  /// given what comes on the node's own channels meanwhile.
  /// @throw Failure: see `poll`; refused by or refusing another; nobody came within the wait.
  virtual void join(const loop::LawInfo& law, const Handler& other) = 0;
  [[nodiscard]] virtual std::int64_t run() const = 0;

  /// The first message of the run has been sent or accepted.
  virtual void started(Time now) = 0;

  /// To be called at the latest at `next_poll`: announcements, faults, silence, interruption.
  /// @throw Failure(interrupted), Failure(peer_lost, protocol_violated or protective_stop) for
  /// another's fault, naming it; Failure(peer_lost) when a playback stops before its end.
  virtual void poll(Time now) = 0;
  [[nodiscard]] virtual Time next_poll() const = 0;

  /// Done once each turn; says when the next turn is due at the latest.
  using Turn = std::function<Time(Time now)>;
  /// Polls and handles what comes until `done`.
  void run_until(const std::function<bool()>& done, const Turn& turn = {});
  /// The same until the run is over.
  /// @param all_there whether all ticks of this process are: before that nobody is believed who
  /// says that it is over
  void run_until_finished(const std::function<bool(Time now)>& all_there, const Turn& turn = {});
  /// Handles one datagram, if one comes before the deadline. @return whether one did
  bool receive(Time deadline);

  enum class Handled {
    no,        ///< it is not on the session's channel
    dropped,   ///< it is, but is not a member's own announcement
    believed,  ///< a member's own announcement
  };
  /// Handles the datagram if it is on the session's channel.
  virtual Handled handle(const bus::Datagram& datagram) = 0;
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

  /// Counts what became of a message for `tick`.
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
  /// @param key of the bus @param interrupted set when the user wants the process to end; may be
  /// null
  Session(loop::Role role, bus::Transport& transport, const std::optional<bus::Key>& key,
          const std::atomic<bool>* interrupted)
      : transport_(transport, key), statistics_(role), interrupted_(interrupted) {}

  void note_start(Time now) { started_at_ = now; }
  void note_end(Time now);
  void throw_if_interrupted() const;

  bus::Authenticated transport_;

 private:
  /// Tells the others that this process ends with `failure`.
  virtual void announce_fault(const diagnostics::Failure& failure) = 0;
  void fail(const diagnostics::Failure& failure);
  [[nodiscard]] diagnostics::Failure two_of(loop::Role role, const bus::Datagram& second,
                                            std::int64_t tick, std::string_view first) const;

  Handler session_handler_;
  // A deque: a handler may add another one while it runs.
  std::deque<std::pair<std::string, Handler>> handlers_;
  Statistics statistics_;
  const std::atomic<bool>* interrupted_;
  Time started_at_;
};

/// A controller's part in a recorded run that lcm-logplayer plays back: it answers the questions of
/// that run at once. Nobody is met and nothing is announced; the run is over with its last tick.
class Playback final : public Session {
 public:
  /// @param wait_s for the first message; 0 = unlimited
  Playback(const experiment::Scenario& scenario, bus::Transport& transport, std::int64_t run,
           double wait_s, const std::atomic<bool>* interrupted);

  void join(const loop::LawInfo& law, const Handler& other) override;
  [[nodiscard]] std::int64_t run() const override { return run_; }
  void started(Time now) override {
    if (tick_ < 0) note_start(now);
  }
  void poll(Time now) override;
  [[nodiscard]] Time next_poll() const override { return next_poll_; }
  Handled handle(const bus::Datagram& /*datagram*/) override { return Handled::no; }
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
  Time progress_at_;
  Time next_poll_;
};

}  // namespace tachless::node
