// The law of flexible joints from positions cannot read a velocity: its measurement has none.
#include "controller/law/flexible_position.h"

using namespace tachless;

using Measurement = controller::law::FlexiblePosition::Measurement;

Vector spring(const Measurement& measured) {
#ifdef FORBIDDEN
  return measured.theta - measured.q + measured.v;
#else
  return measured.theta - measured.q;
#endif
}
