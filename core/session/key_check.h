#pragma once

#include <string>

#include "base/clock.h"
#include "bus/authenticated.h"
#include "messages/messages.h"

namespace tachless::session {

/// Detector of a key that differs from the key of the other processes, or that only one side has.
/// It counts announcements that do not verify while a process waits for the others. It verifies
/// nothing itself.
class KeyCheck {
 public:
  using Time = base::Clock::time_point;

  KeyCheck(messages::Role own_role, bool has_key) : own_role_(own_role), has_key_(has_key) {}

  /// Takes note of an announcement that verified: the keys agree.
  void on_verified() { accepted_ = true; }

  /// Takes note of an announcement that did not verify.
  void on_foreign(const bus::Stranger& stranger, Time now);

  /// Describes the first foreign announcement, to be appended to a message about missing processes.
  /// Returns an empty text if there was none.
  [[nodiscard]] std::string hint() const;

  /// @throw Failure(protocol_violated) if only foreign announcements have come for 1.5 s.
  void poll(Time now) const;

 private:
  messages::Role own_role_;
  bool has_key_;
  bool accepted_ = false;
  int num_foreign_ = 0;
  std::string first_;  ///< description of the first foreign announcement
  Time since_;
};

}  // namespace tachless::session
