// The flexible-joint law of the paper cannot read motor velocity: its measurement has none.
#include "controller/law/loria_ortega_flexible.h"

using namespace tachless;

using Measurement = controller::law::LoriaOrtegaFlexible::Measurement;

Vector rate(const Measurement& measured) {
#ifdef FORBIDDEN
  return measured.thetadot;
#else
  return measured.v;
#endif
}
