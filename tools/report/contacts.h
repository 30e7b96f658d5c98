#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "base/quantities.h"
#include "messages/truth/tick_record.h"

namespace tachless::report {

/// Contacts of a simulated robot in a run.
struct Contacts {
  /// The two geoms with the largest contact force, and the time.
  struct Pair {
    double time_s = 0;
    std::string geoms;
    double force = 0;  ///< [N]
  };

  std::string simulator;   ///< name and version of the simulator; empty: the log has no contacts
  std::int64_t ticks = 0;  ///< with a contact
  Pair first;
  Pair largest;
  /// The joint was at its limit in a tick with a contact.
  std::array<bool, max_joints> saturated{};

  /// Adds a tick at time `t_s`.
  void add(const messages::TickRecord& record, double t_s);

  /// Returns "contact from 1.22 s (tip, wall), up to 520 N: joints 2, 4, 6 at their limits"; empty
  /// without a contact.
  [[nodiscard]] std::string text() const;
  /// Returns the same with a capital letter; without a contact "No contact".
  [[nodiscard]] std::string heading() const;
};

/// Returns `{simulator, ticks, first {time_s, geoms, force_N}, largest {…}, saturated_joints}`;
/// joints count from 1. Null if the log has no contacts; `first` and `largest` are null without a
/// contact.
nlohmann::ordered_json to_json(const Contacts& contacts);

}  // namespace tachless::report
