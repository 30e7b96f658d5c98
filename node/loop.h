#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <string_view>
#include <utility>

#include "bus/transport.h"
#include "node/session.h"
#include "protocol/lockstep/verdict.h"

namespace tachless::node {

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
