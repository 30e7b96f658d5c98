// The full state cannot be handed to a law that measures motor positions.
#include "controller/law/rivals/kelly_flexible.h"

namespace tachless::state_is_no_motor_position_measurement {

using Law = controller::law::KellyFlexible;

controller::law::Step<Law::Memory> twin(const Law& law, const Law::Memory& memory,
                                        const messages::StateMeasurement& state,
                                        const messages::ReferencePoint& reference) {
  return law.step(memory, messages::MotorPositionMeasurement{state.theta}, reference);
}
controller::law::Step<Law::Memory> step(const Law& law, const Law::Memory& memory,
                                        const messages::StateMeasurement& state,
                                        const messages::ReferencePoint& reference) {
  return law.step(memory, state, reference);  // refused
}

}  // namespace tachless::state_is_no_motor_position_measurement
