// A law that measures positions cannot read velocity: its measurement has none.
#include "controller/law/law.h"

using namespace tachless;

namespace {

struct Peeking {
  using Measurement = messages::PositionMeasurement;

  [[nodiscard]] messages::TorqueCommand act(const Measurement& measurement) const {
#ifdef FORBIDDEN
    return {-measurement.q - measurement.v};
#else
    return {-measurement.q};
#endif
  }
};

}  // namespace

messages::TorqueCommand act(const messages::PositionMeasurement& measurement) {
  return Peeking{}.act(measurement);
}
