#pragma once

#include <string>
#include <string_view>

#include "bus/authenticated.h"
#include "loop/clock.h"
#include "loop/messages.h"

namespace tachless::node {

/// Notices, while a process waits for the others, that it is on a bus with another key than theirs
/// (or that only one side has one): announcements come, and none of them verifies. Verifies nothing
/// itself.
class KeyCheck {
 public:
  KeyCheck(loop::Role own_role, bool has_key) : own_role_(own_role), has_key_(has_key) {}

  /// An announcement that verified: the keys agree.
  void accepted() { accepted_ = true; }
  /// One that did not, though it is an announcement.
  void foreign(bus::Foreign kind, const loop::Participant& who, std::string_view sender,
               loop::Clock::time_point now);
  /// @throw Failure(protocol_violated) when only foreign ones have been heard for 1.5 s.
  void poll(loop::Clock::time_point now) const;

 private:
  loop::Role own_role_;
  bool has_key_;
  bool accepted_ = false;
  int num_foreign_ = 0;
  std::string first_;  ///< the first foreign one, in words
  loop::Clock::time_point since_;
};

}  // namespace tachless::node
