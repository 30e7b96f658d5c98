#include "plant/measurement_source.h"

#include <fmt/core.h>

#include "diagnostics/failure.h"
#include "loop/measurements.h"
#include "plant/guarded_robot.h"

namespace tachless::plant {
namespace {

template <class Measurement>
class Source : public MeasurementSource {
 public:
  Source(const experiment::Scenario& scenario, const Encoder& encoder, const loop::Layout& layout)
      : channel_(loop::channel<Measurement>(scenario.robot.channel_prefix)),
        encoder_(encoder),
        codec_(layout) {
    require_encoders<Measurement>(scenario);
  }

  std::span<const std::byte> measure(const ArmState& state, const loop::Stamp& stamp) override {
    const Measurement measurement = encoder_.template measure<Measurement>(state, stamp.tick);
    if (!bus::all_finite(measurement)) throw not_finite(stamp.tick);
    return codec_.encode(stamp, measurement);
  }

  [[nodiscard]] std::string channel() const override { return channel_; }
  [[nodiscard]] std::size_t longest() const override { return codec_.longest(); }

 private:
  std::string channel_;
  const Encoder& encoder_;
  bus::Codec<Measurement> codec_;
};

}  // namespace

std::unique_ptr<MeasurementSource> make_measurement_source(std::string_view suffix,
                                                           const experiment::Scenario& scenario,
                                                           const Encoder& encoder,
                                                           const loop::Layout& layout) {
  std::unique_ptr<MeasurementSource> source;
  loop::with_measurement(suffix, [&]<class M>(std::type_identity<M>) {
    source = std::make_unique<Source<M>>(scenario, encoder, layout);
  });
  if (!source) {
    throw diagnostics::Failure(diagnostics::ExitCode::protocol_violated,
                               "the controller asks for the measurement '{}'; the plant has "
                               "POSITION, MOTOR_POSITION, LINK_STATE and STATE",
                               suffix);
  }
  return source;
}

}  // namespace tachless::plant
