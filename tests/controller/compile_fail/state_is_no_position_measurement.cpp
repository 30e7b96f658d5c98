// The full state cannot be handed to a law that measures positions: there is no conversion.
#include "controller/law/loria_ortega_rigid.h"

using namespace tachless;

using Law = controller::law::LoriaOrtegaRigid;

controller::law::Step<Law::Memory> step(const Law& law, const Law::Memory& memory,
                                        const messages::StateMeasurement& state,
                                        const messages::ReferencePoint& reference) {
#ifdef FORBIDDEN
  return law.step(memory, state, reference);
#else
  return law.step(memory, messages::PositionMeasurement{state.q}, reference);
#endif
}
