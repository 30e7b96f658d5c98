#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <initializer_list>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "base/clock.h"
#include "base/failure.h"
#include "bus/authenticated.h"
#include "messages/messages.h"
#include "messages/wire.h"
#include "scenario/scenario.h"
#include "session/key_check.h"
#include "session/membership.h"
#include "session/message_ring.h"
#include "session/peers.h"
#include "session/statistics.h"

namespace tachless::session {

/// One process's part in a run, with the loop that waits for messages. Call `on` for each channel,
/// then `join`, `run_until_finished` and `leave`. The class carries out the decisions of
/// session::Membership over a transport. It sends and decodes announcements, authenticates the bus
/// if there is a key, and names missing processes to the user.
///
/// A datagram is an announcement or goes to the handler of its channel. The handler checks it with
/// `accept` and passes the receipt to `count`. The class knows no other message and no tick.
class Session {
 public:
  using Time = base::Clock::time_point;
  using Handler = std::function<void(const bus::Datagram&)>;

  struct Config {
    messages::Role role = messages::Role::plant;
    std::optional<std::int64_t> run_id = {};  ///< plant only; default: microseconds since 1970
    double wait_s = 0;  ///< longest wait for the other processes at the start; 0: unlimited
    /// Becomes true when the user wants the process to end.
    const std::atomic<bool>* interrupted = nullptr;
    std::int64_t instance = 0;         ///< distinguishes two processes of one role; 0: a random one
    std::optional<bus::Key> key = {};  ///< key of the bus
  };

  /// Subscribes to the participants' channel.
  Session(const scenario::Scenario& scenario, bus::Transport& transport, const Config& config);
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  /// Returns the membership of this process among the four.
  session::Membership& membership() { return *membership_; }
  [[nodiscard]] std::int64_t run() const { return membership_->run(); }
  /// Returns e.g. "the controller (process 123 on host arm-1, 10.0.0.2:4123)".
  [[nodiscard]] std::string describe(messages::Role role) const {
    return membership_->describe(role);
  }
  Statistics& statistics() { return statistics_; }

  /// Returns the channel of the announcements.
  [[nodiscard]] const std::string& channel() const { return channel_; }

  /// Publishes bytes of a codec.
  void publish(std::string_view channel, std::span<const std::byte> bytes) {
    transport_.publish(channel, bytes);
  }
  /// Encodes a value and publishes it.
  /// @return the bytes, which are valid until the port encodes again
  template <class Value>
  std::span<const std::byte> publish(messages::Port<Value>& port, const messages::Stamp& stamp,
                                     const Value& value) {
    const auto bytes = port.codec.encode(stamp, value);
    publish(port.channel, bytes);
    return bytes;
  }

  /// Subscribes to `channel`; `receive` and `run_until` pass its messages to `handler`.
  void on(const std::string& channel, Handler handler);
  /// Subscribes to the channel of `port`, which must outlive this object. Each message that passes
  /// `accept` goes to `on_value(stamp, value, datagram)`; others are counted.
  /// @param inspect is called first for each message as `inspect(rejection, datagram)`, and may
  /// throw
  template <class Value, class OnValue, class Inspect>
  void on(const messages::Port<Value>& port, OnValue on_value, Inspect inspect) {
    on(port.channel,
       [this, &port, on_value = std::move(on_value), inspect = std::move(inspect),
        stamp = messages::Stamp(), value = Value()](const bus::Datagram& datagram) mutable {
         const auto rejection = port.codec.decode(datagram.payload, stamp, value);
         inspect(rejection, datagram);
         if (accept(rejection, stamp)) on_value(std::as_const(stamp), value, datagram);
       });
  }
  template <class Value, class OnValue>
  void on(const messages::Port<Value>& port, OnValue on_value) {
    on(port, std::move(on_value), [](messages::Rejection, const bus::Datagram&) {});
  }
  /// Passes announcements that are a member's own (session::Membership::handle) to `handler`, after
  /// they have been handled.
  void on_announcement(Handler handler) { announcement_handler_ = std::move(handler); }

  /// Runs `main`, the node's whole life. An exception that leaves `main` is noted in the
  /// statistics, announced, and thrown again.
  void guard(const std::function<void()>& main);

  /// Waits until the run is known; the plant waits until all are ready.
  /// @param law of a controller only
  /// @param other receives the messages on the node's own channels during the wait
  /// @throw Failure as `poll` does, if this process refuses another one or is refused, and if roles
  /// are missing after `Config::wait_s`
  void join(const messages::LawInfo& law, const Handler& other);
  /// Notes that the first message of the run has been sent or accepted.
  void note_started(Time now);

  /// Handles due announcements, faults, silence and interruption. Call it at the latest at
  /// `next_poll`.
  /// @throw Failure(interrupted); Failure(peer_lost, protocol_violated or protective_stop) for
  /// another process's fault, naming that process
  void poll(Time now);
  [[nodiscard]] Time next_poll() const { return membership_->next_announcement(); }

  /// Function called once each turn; it returns the latest time of the next turn.
  using Turn = std::function<Time(Time now)>;
  /// Polls and handles messages until `done`.
  void run_until(const std::function<bool()>& done, const Turn& turn = {});
  /// Polls and handles announcements alone until `done`, for a process that has all messages of its
  /// run.
  void attend_until(const std::function<bool()>& done);
  /// Polls and handles messages until the plant has finished.
  /// @param all_there returns whether this process has all ticks; until then the end of the run is
  /// not accepted
  void run_until_finished(const std::function<bool(Time now)>& all_there, const Turn& turn = {});
  /// Handles one datagram if one arrives before the deadline.
  /// @return whether one arrived
  bool receive(Time deadline);
  /// Makes `attend` call `each` once per `period` from now on, for a process with a task to repeat
  /// until it ends. An empty function ends these calls.
  void while_attending(std::chrono::nanoseconds period, std::function<void()> each);
  /// Handles the announcements that arrive before the deadline, or until it is `over`.
  void attend(
      Time deadline, const std::function<bool()>& over = [] { return false; });

  enum class Handled {
    no,        ///< another channel
    dropped,   ///< on the announcements' channel, but no member's own announcement
    believed,  ///< a member's own announcement
  };
  /// Handles the datagram if it is on the announcements' channel.
  Handled handle(const bus::Datagram& datagram);

  /// Returns whether a decoded message is valid and of this run; counts it otherwise.
  bool accept(messages::Rejection rejection, const messages::Stamp& stamp);
  /// Counts the receipt on a message for `tick`.
  /// @throw Failure(protocol_violated) if the message conflicts: two processes have the role
  /// `from`. The failure names the last sender that is not the role's holder.
  void count(session::Receipt receipt, messages::Role from, const bus::Datagram& datagram,
             std::int64_t tick);
  /// Counts a receipt; a conflict is not counted.
  void count(session::Receipt receipt);

  /// Sets the newest handled tick and, for a controller, the norm of its position error [rad].
  void note_progress(std::int64_t tick, double error_norm = 0) {
    membership_->on_progress(tick, error_norm);
  }
  /// Finishes this process's part. The plant waits until the others have finished. While they lack
  /// ticks, it waits at most the time to give up plus 2 s. Otherwise it waits at most the time to
  /// give up plus 60 s. The others wait until all have finished and the plant has acknowledged
  /// their own end, at most a second.
  /// @throw Failure if another process has failed during the wait, or (protocol_violated) if the
  /// plant waited too long
  void leave();

  /// Announces that this process will end with `failure` after it has brought the robot to rest.
  void announce_stop(const base::Failure& failure, Time now);
  /// Announces that this process ends with `failure`, before it concludes.
  /// @return the announcement's bytes, valid until the next announcement
  std::span<const std::byte> announce_end(const base::Failure& failure);
  /// Publishes the announcement if it is due, for a process that is ending.
  void announce_if_due(Time now) {
    if (now >= next_poll()) announce(now);
  }

  /// Describes the roles that have been silent for a second; all of these roles, if none has.
  [[nodiscard]] std::string silent_among(std::initializer_list<messages::Role> roles) const;
  /// Returns whether a message may come from the role's holder. Without a key the message has to
  /// come from the holder's address. With a key any address may be the holder's, because others may
  /// have forwarded its announcements.
  [[nodiscard]] bool is_from(messages::Role role, std::string_view sender) const {
    return transport_.has_key() || membership_->is_from(role, sender);
  }
  /// Returns the number of datagrams dropped because they did not verify under the key.
  [[nodiscard]] std::int64_t unauthenticated() const { return transport_.dropped(); }

 private:
  void fail(const base::Failure& failure);
  void note_end(Time now);
  void throw_if_interrupted() const;
  std::span<const std::byte> announce(Time now);
  void announce_repeatedly();
  void name_missing(Time now);

  bus::Authenticated transport_;
  Statistics statistics_;
  const std::atomic<bool>* interrupted_;
  Time started_at_;
  Handler announcement_handler_;
  /// Handlers by channel number. It is a deque because a handler may add another one while it runs.
  std::deque<Handler> handlers_;
  std::string channel_;
  int channel_number_;  ///< number of `channel_`
  session::Membership::Self self_;
  std::optional<session::Membership> membership_;
  messages::Codec<messages::Participant> codec_;
  messages::Stamp stamp_;       ///< stamp of the last announcement received
  messages::Participant peer_;  ///< content of that announcement
  KeyCheck key_check_;
  /// By role: the last sender of its messages that is not its holder; empty if there was none.
  std::array<std::string, messages::num_roles> other_senders_;
  messages::PerRole entered_{};  ///< roster of the session that the bus has entered
  Time next_notice_;
  std::function<void()> each_;  ///< function of `while_attending`
  std::chrono::nanoseconds each_period_{};
  Time next_each_;
};

}  // namespace tachless::session
