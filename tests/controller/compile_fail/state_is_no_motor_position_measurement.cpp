// The full state cannot be handed to a law that measures motor positions.
#include "controller/law/rivals/kelly_flexible.h"

using namespace tachless;

using Law = controller::law::KellyFlexible;

controller::law::Step<Law::Memory> step(const Law& law, const Law::Memory& memory,
                                        const messages::StateMeasurement& state,
                                        const messages::ReferencePoint& reference) {
#ifdef FORBIDDEN
  return law.step(memory, state, reference);
#else
  return law.step(memory, messages::MotorPositionMeasurement{state.theta}, reference);
#endif
}
