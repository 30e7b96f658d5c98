// A law that measures the state is no output-feedback law, whatever it says of itself.
#include <array>

#include "controller/law/law.h"

using namespace tachless;

namespace {

#ifdef FORBIDDEN
using Measured = loop::StateMeasurement;
#else
using Measured = loop::PositionMeasurement;
#endif

struct Claiming {
  static constexpr const char* name = "claiming";
  static constexpr std::array<loop::Signal, 0> signals = {};
  using Measurement = Measured;
  struct Memory {};
  [[nodiscard]] Memory start(const Measurement& /*measured*/,
                             const loop::ReferencePoint& /*reference*/) const {
    return {};
  }
  [[nodiscard]] controller::law::Step<Memory> step(const Memory& memory,
                                                   const Measurement& measured,
                                                   const loop::ReferencePoint& /*reference*/,
                                                   int /*ticks*/ = 1) const {
    return {memory, {-measured.q}, {}};
  }
};

static_assert(controller::law::Law<Claiming>);
static_assert(controller::law::OutputFeedbackLaw<Claiming>);

}  // namespace
