#pragma once

#include "loop/signals.h"

namespace tachless::controller::law {

/// Base of the laws that are fed the full state and keep nothing from one tick to the next.
struct FullState {
  using Measurement = loop::StateMeasurement;
  struct Memory {};

  [[nodiscard]] static Memory start(const Measurement& /*measurement*/,
                                    const loop::ReferencePoint& /*reference*/) {
    return {};
  }
};

}  // namespace tachless::controller::law
