// A controller program with a law of one's own: docs/own_law.md.
#include <tachless/controller/law/parts.h>
#include <tachless/controller/program.h>

using namespace tachless;
using namespace controller::law;

namespace {

// The scenario's controller.gains: names, units, meaning. All are above 0.
struct MyGains {
  Vector kp, kd, a, b;

  static constexpr std::tuple keys{
      gain("kp", &MyGains::kp, "N m/rad", "Weight of the position error"),
      gain("kd", &MyGains::kd, "N m s/rad", "Weight of the filter output"),
      gain("a", &MyGains::a, "1/s", "Filter pole"), gain("b", &MyGains::b, "1/s", "Filter gain")};
};

/// Loria and Ortega's law for rigid joints, tau = ID(q, v_ref, a_ref) - Kp e - Kd nu, with a
/// backward Euler filter nu_k = (nu_{k-1} + B (e_k - e_{k-1})) / (1 + A h).
class MyLaw : public RigidLaw<MyGains> {
 public:
  // Texts that report, info and error messages print.
  static constexpr std::string_view name = "my_law", source = "own work";
  static constexpr std::string_view proved = "nothing yet", conditions = "none known";
  static constexpr std::array signals = {Signal{"error", "rad"}, Signal{"nu", "rad/s"}};

  using Measurement = messages::PositionMeasurement;  // all that the law receives

  struct Memory {           // kept between ticks
    Vector nu, e_previous;  // [rad/s], [rad]
    static constexpr std::tuple members{&Memory::nu, &Memory::e_previous};
  };

  using LawOf::LawOf;

  Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    return {Vector::Zero(measured.q.size()), measured.q - reference.q_ref};
  }

  /// Computes the command; called once per period. The caller interpolates lost measurements.
  Step<Memory> step(const Memory& memory, const Measurement& measured,
                    const ReferencePoint& reference) const {
    const auto [v_ref, a_ref] = ahead(reference);
    const Vector e = measured.q - reference.q_ref,
                 growth = 1 + gains_.a.array() * settings_.period_s;
    const Vector nu =
        (memory.nu + gains_.b.cwiseProduct(e - memory.e_previous)).cwiseQuotient(growth);
    const Vector tau = robot::inverse_dynamics(robot_, measured.q, v_ref, a_ref) -
                       gains_.kp.cwiseProduct(e) - gains_.kd.cwiseProduct(nu);
    return {{nu, e}, {tau}, {signals.size(), {e, nu}}};
  }
};

static_assert(OutputFeedbackLaw<MyLaw>);

}  // namespace

int main(int argc, char** argv) { return run_controller<MyLaw>(argc, argv); }
