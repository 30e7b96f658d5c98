// A law that measures the state is no output-feedback law, whatever it declares.
#include <array>
#include <tuple>

#include "controller/law/law.h"

using namespace tachless;

namespace {

#ifdef FORBIDDEN
using Measured = messages::StateMeasurement;
#else
using Measured = messages::PositionMeasurement;
#endif

struct Claiming {
  static constexpr const char* name = "claiming";
  static constexpr std::array<messages::Signal, 0> signals = {};
  static constexpr const char* source = "";
  static constexpr const char* proved = "";
  static constexpr const char* conditions = "";
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = false;
  struct Gains {
    static constexpr std::tuple<> keys{};
  };
  using Measurement = Measured;
  struct Memory {};
  [[nodiscard]] Memory start(const Measurement& /*measured*/,
                             const messages::ReferencePoint& /*reference*/) const {
    return {};
  }
  [[nodiscard]] controller::law::Step<Memory> step(
      const Memory& memory, const Measurement& measured,
      const messages::ReferencePoint& /*reference*/) const {
    return {memory, {-measured.q}, {}};
  }
};

static_assert(controller::law::Law<Claiming>);
static_assert(controller::law::OutputFeedbackLaw<Claiming>);

}  // namespace
