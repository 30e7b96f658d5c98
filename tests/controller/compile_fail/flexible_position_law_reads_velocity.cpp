// The law of flexible joints from positions cannot read a velocity: its measurement has none.
#include "controller/law/flexible_position.h"

namespace tachless::flexible_position_law_reads_velocity {

using Measurement = controller::law::FlexiblePosition::Measurement;

Vector twin(const Measurement& measured) { return measured.theta - measured.q; }
Vector spring(const Measurement& measured) {
  return measured.theta - measured.q + measured.v;  // refused
}

}  // namespace tachless::flexible_position_law_reads_velocity
