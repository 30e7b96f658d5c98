#pragma once

/// The tick protocol as pure state machines: events in, actions out, time passed in as a value.
/// They neither send nor receive, know no message type, and compute no message. docs/protocol.md
/// describes the protocol as a whole.
namespace tachless::protocol::lockstep {

/// What was done with one message.
enum class Verdict {
  fresh,        ///< taken
  repeated,     ///< the same bytes as before
  not_asked,    ///< of a tick that was not requested
  too_old,      ///< of a tick whose messages are no longer kept
  conflicting,  ///< other bytes than before for the same tick: two processes have one role
};

}  // namespace tachless::protocol::lockstep
