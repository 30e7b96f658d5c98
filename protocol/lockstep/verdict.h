#pragma once

#include <string_view>

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
  conflicting,  ///< other bytes than before for the same tick: two processes play one role
};

inline std::string_view name(Verdict verdict) {
  switch (verdict) {
    case Verdict::fresh:
      return "fresh";
    case Verdict::repeated:
      return "repeated";
    case Verdict::not_asked:
      return "not_asked";
    case Verdict::too_old:
      return "too_old";
    case Verdict::conflicting:
      return "conflicting";
  }
  return "unknown";
}

}  // namespace tachless::protocol::lockstep
