// Nor to a law that is fed motor positions.
#include "controller/law/kelly_flexible.h"

using Law = controller::law::KellyFlexible;

controller::law::Step<Law::Memory> step(const Law& law, const Law::Memory& memory,
                                        const robot::StateMeasurement& state,
                                        const robot::ReferencePoint& reference) {
#ifdef FORBIDDEN
  return law.step(memory, state, reference);
#else
  return law.step(memory, robot::MotorPositionMeasurement{state.theta}, reference);
#endif
}
