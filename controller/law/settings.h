#pragma once

#include <string_view>

#include "controller/law/filter.h"
#include "robot/quantities.h"

namespace tachless::controller::law {

/// What does not belong to one law: sampling.
struct Settings {
  double period_s = 1e-3;  ///< h [s]
  Discretisation filter = Discretisation::first_order_hold;
  FilterStart filter_start = FilterStart::at_error;
  double feedforward_lead_s = 0;  ///< how far ahead the feed-forward is evaluated [s]
};

/// A gain by the name that it has in a scenario. Every gain is a vector with one entry per joint,
/// each greater than 0.
template <class Gains>
struct GainName {
  std::string_view name;
  robot::Vector Gains::*value;
};

}  // namespace tachless::controller::law
