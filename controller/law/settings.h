#pragma once

#include "controller/law/filter.h"
#include "robot/quantities.h"

namespace tachless::controller::law {

/// What does not belong to one law: sampling. Parameters are a law's own.
struct Settings {
  double period_s = 1e-3;  ///< h [s]
  Discretisation filter = Discretisation::first_order_hold;
  FilterStart filter_start = FilterStart::at_error;
  double feedforward_lead_s = 0;  ///< how far ahead the feed-forward is evaluated [s]
  /// Standard deviation of a measured position as the encoder's data sheet has it [rad]; zero or
  /// empty: ideal.
  robot::Vector position_std{};
  /// Ticks from the state that was measured to the one over which the command that answers it acts,
  /// the encoder's latency included; at most most_delay.
  int command_delay = 0;

  static constexpr int most_delay = 32;
};

}  // namespace tachless::controller::law
