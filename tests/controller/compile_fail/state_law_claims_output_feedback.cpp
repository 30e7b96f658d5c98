// A law that measures the state is no output-feedback law, whatever it declares.
#include <array>
#include <tuple>

#include "controller/law/law.h"

namespace tachless::state_law_claims_output_feedback {

template <class Measured>
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

static_assert(controller::law::Law<Claiming<messages::StateMeasurement>>);
static_assert(controller::law::OutputFeedbackLaw<Claiming<messages::PositionMeasurement>>);
static_assert(controller::law::OutputFeedbackLaw<Claiming<messages::StateMeasurement>>);  // refused

}  // namespace tachless::state_law_claims_output_feedback
