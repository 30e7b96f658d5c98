// The full state cannot be handed to a law that measures positions: there is no conversion.
#include "controller/law/loria_ortega_rigid.h"

namespace tachless::state_is_no_position_measurement {

using Law = controller::law::LoriaOrtegaRigid;

controller::law::Step<Law::Memory> twin(const Law& law, const Law::Memory& memory,
                                        const messages::StateMeasurement& state,
                                        const messages::ReferencePoint& reference) {
  return law.step(memory, messages::PositionMeasurement{state.q}, reference);
}
controller::law::Step<Law::Memory> step(const Law& law, const Law::Memory& memory,
                                        const messages::StateMeasurement& state,
                                        const messages::ReferencePoint& reference) {
  return law.step(memory, state, reference);  // refused
}

}  // namespace tachless::state_is_no_position_measurement
