// A law that is fed positions cannot read velocity: its measurement has none.
#include "controller/law/law.h"

namespace {

struct Peeking {
  using Measurement = robot::PositionMeasurement;

  [[nodiscard]] robot::TorqueCommand act(const Measurement& measurement) const {
#ifdef FORBIDDEN
    return {-measurement.q - measurement.v};
#else
    return {-measurement.q};
#endif
  }
};

}  // namespace

robot::TorqueCommand act(const robot::PositionMeasurement& measurement) {
  return Peeking{}.act(measurement);
}
