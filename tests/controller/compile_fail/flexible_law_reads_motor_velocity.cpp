// The flexible-joint law of the paper cannot read motor velocity: its measurement has none.
#include "controller/law/loria_ortega_flexible.h"

namespace tachless::flexible_law_reads_motor_velocity {

using Measurement = controller::law::LoriaOrtegaFlexible::Measurement;

Vector twin(const Measurement& measured) { return measured.v; }
Vector rate(const Measurement& measured) {
  return measured.thetadot;  // refused
}

}  // namespace tachless::flexible_law_reads_motor_velocity
