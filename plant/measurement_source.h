#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "bus/wire.h"
#include "experiment/scenario.h"
#include "plant/arm.h"
#include "plant/encoder.h"

namespace tachless::plant {

/// The measurement that the controller of this run needs, as message bytes: one of the four of
/// loop/signals.h, chosen once at the start. Reads the encoders' model, not a robot.
class MeasurementSource {
 public:
  virtual ~MeasurementSource() = default;

  /// Reads the encoders; the bytes are valid until the next call.
  /// @throw diagnostics::Failure(protective_stop) when the state is not finite.
  virtual std::span<const std::byte> measure(const ArmState& state, const loop::Stamp& stamp) = 0;

  [[nodiscard]] virtual std::string channel() const = 0;
  [[nodiscard]] virtual std::size_t longest() const = 0;  ///< of its messages [bytes]
};

/// @param suffix of the channel that the controller asked for
/// @throw diagnostics::Failure: bad_usage when the robot lacks the encoders, protocol_violated when
/// there is no such measurement.
std::unique_ptr<MeasurementSource> make_measurement_source(std::string_view suffix,
                                                           const experiment::Scenario& scenario,
                                                           const Encoder& encoder,
                                                           const loop::Layout& layout);

}  // namespace tachless::plant
