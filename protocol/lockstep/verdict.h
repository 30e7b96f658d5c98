#pragma once

/// The tick protocol as pure state machines: events in, actions out, time passed in as a value.
/// They neither send nor receive, know no message type, and compute nothing. docs/protocol.md
/// tells the whole.
namespace tachless::protocol::lockstep {

/// What became of one message.
enum class Verdict {
  fresh,        ///< taken
  repeated,     ///< the same bytes as before
  not_asked,    ///< of a tick that nobody has asked for
  too_old,      ///< of a tick whose messages are no longer kept
  conflicting,  ///< other bytes than before for the same tick: two processes have one role
};

}  // namespace tachless::protocol::lockstep
