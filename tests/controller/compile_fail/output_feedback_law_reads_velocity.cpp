// A law that measures positions cannot read velocity: its measurement has none.
#include "controller/law/law.h"

namespace tachless::output_feedback_law_reads_velocity {

struct Peeking {
  using Measurement = messages::PositionMeasurement;

  [[nodiscard]] messages::TorqueCommand twin(const Measurement& measurement) const {
    return {-measurement.q};
  }
  [[nodiscard]] messages::TorqueCommand act(const Measurement& measurement) const {
    return {-measurement.q - measurement.v};  // refused
  }
};

}  // namespace tachless::output_feedback_law_reads_velocity
