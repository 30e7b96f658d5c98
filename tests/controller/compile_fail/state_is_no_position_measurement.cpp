// The full state cannot be handed to a law that is fed positions: there is no conversion.
#include "controller/law/loria_ortega_rigid.h"

using Law = controller::law::LoriaOrtegaRigid;

controller::law::Step<Law::Memory> step(const Law& law, const Law::Memory& memory,
                                        const robot::StateMeasurement& state,
                                        const robot::ReferencePoint& reference) {
#ifdef FORBIDDEN
  return law.step(memory, state, reference);
#else
  return law.step(memory, robot::PositionMeasurement{state.q}, reference);
#endif
}
