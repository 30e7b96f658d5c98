#pragma once

#include <fmt/core.h>

#include <chrono>
#include <string>
#include <string_view>

#include "bus/authenticated.h"
#include "diagnostics/failure.h"
#include "loop/clock.h"
#include "loop/messages.h"
#include "protocol/peers.h"

namespace tachless::node {

/// Notices, while a process waits for the others, that it is on a bus with another key than theirs
/// (or that only one side has one): announcements come, and none of them verifies. Verifies nothing
/// itself.
class KeyCheck {
 public:
  using Time = loop::Clock::time_point;

  KeyCheck(loop::Role own_role, bool has_key) : own_role_(own_role), has_key_(has_key) {}

  /// An announcement that verified: the keys agree.
  void accepted() { accepted_ = true; }

  /// One that did not, though it is an announcement.
  void foreign(const bus::Stranger& stranger, Time now) {
    if (num_foreign_++ > 0) return;
    since_ = now;
    const std::string_view own = loop::name(own_role_);
    std::string difference = fmt::format("has no key, this {} has one", own);
    if (stranger.tagged) {
      difference = has_key_ ? fmt::format("has another key than this {}", own)
                            : fmt::format("has a key, this {} has none", own);
    }
    first_ = fmt::format("{} {}", protocol::describe(stranger.who, stranger.sender), difference);
  }

  /// @throw Failure(protocol_violated) when only foreign ones have come for 1.5 s.
  void poll(Time now) const {
    // No announcement that verifies among so many for so long: the keys differ.
    if (accepted_ || num_foreign_ < 5 || now - since_ < std::chrono::milliseconds(1500)) return;
    throw diagnostics::Failure(
        diagnostics::ExitCode::protocol_violated,
        "{}; give all four programs the same --key-file (or TACHLESS_KEY_FILE)", first_);
  }

 private:
  loop::Role own_role_;
  bool has_key_;
  bool accepted_ = false;
  int num_foreign_ = 0;
  std::string first_;  ///< the first foreign one, in words
  Time since_;
};

}  // namespace tachless::node
