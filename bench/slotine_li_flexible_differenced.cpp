// A controller program: slotine_li_flexible with the differences of both encoders for velocities.
// docs/studies/study_flexible_positions.md compares it.
#include "controller/law/rivals/slotine_li_flexible.h"
#include "controller/program.h"

namespace tachless::controller::law {
namespace {

/// `SlotineLiFlexible` fed with (y_k - y_{k-1}) / h. Its first velocities are those of the
/// reference.
class SlotineLiFlexibleDifferenced : public FlexibleLaw<SlotineLiFlexibleGains> {
 public:
  static constexpr std::string_view name = "slotine_li_flexible_differenced";
  static constexpr std::array signals = SlotineLiFlexible::signals;
  static constexpr std::string_view source = SlotineLiFlexible::source;
  static constexpr std::string_view proved = "nothing";
  static constexpr std::string_view conditions = "none";

  using Measurement = messages::BothPositionsMeasurement;
  struct Memory {
    Vector q, theta;  // of the tick before [rad]

    static constexpr std::tuple members{&Memory::q, &Memory::theta};
  };
  using LawOf::LawOf;

  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    const Vector of_springs = robot::first_derivative(feedforward_torque(robot_.links, reference))
                                  .cwiseQuotient(robot_.stiffness);
    return {measured.q - settings_.period_s * reference.v_ref,
            measured.theta - settings_.period_s * (reference.v_ref + of_springs)};
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    const double h = settings_.period_s;
    const auto step = law_.step({},
                                {measured.q, (measured.q - memory.q) / h, measured.theta,
                                 (measured.theta - memory.theta) / h},
                                reference);
    return {{measured.q, measured.theta}, step.command, step.signals};
  }

 private:
  SlotineLiFlexible law_{robot_, gains_, settings_};
};

}  // namespace
}  // namespace tachless::controller::law

int main(int argc, char** argv) {
  return tachless::run_controller<tachless::controller::law::SlotineLiFlexibleDifferenced>(argc,
                                                                                           argv);
}
