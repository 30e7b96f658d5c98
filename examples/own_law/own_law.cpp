// A controller program with a user's own control law: docs/install.md. `MyLaw` holds the code
// specific to the law, equations and declarations.

#include <array>
#include <string_view>
#include <tuple>
#include <utility>

#include <tachless/base/schema.h>
#include <tachless/controller/law/law.h>
#include <tachless/controller/program.h>
#include <tachless/robot/dynamics.h>
#include <tachless/robot/model.h>

using namespace tachless;

namespace {

/// Loria and Ortega's law for rigid joints, from positions alone:
///
///   tau = ID(q, v_ref, a_ref) - Kp e - Kd nu,   nudot = -A nu + B edot,   e = q - q_ref,
///
/// with a backward Euler filter: nu_k = (nu_{k-1} + B (e_k - e_{k-1})) / (1 + A h).
class MyLaw {
 public:
  // Texts that report, info and error messages print.
  static constexpr std::string_view name = "my_law";
  static constexpr std::array signals = {messages::Signal{"error", "rad"},
                                         messages::Signal{"nu", "rad/s"}};
  static constexpr std::string_view source = "own work";
  static constexpr std::string_view proved = "nothing yet";
  static constexpr std::string_view conditions = "none known";
  static constexpr bool regulation_only = false;
  static constexpr bool has_feedforward_lead = false;

  // The measurement, which is all that the law receives.
  using Measurement = messages::PositionMeasurement;
  using Robot = robot::Model;

  // The scenario's controller.gains: names, units, allowed values.
  struct Gains {
    Vector kp, kd, a, b;

    static constexpr std::tuple keys{
        base::Key{"kp", &Gains::kp, "N m/rad", "Weight of the position error"}.in(base::positive),
        base::Key{"kd", &Gains::kd, "N m s/rad", "Weight of the filter output"}.in(base::positive),
        base::Key{"a", &Gains::a, "1/s", "Filter pole"}.in(base::positive),
        base::Key{"b", &Gains::b, "1/s", "Filter gain"}.in(base::positive)};
  };

  // The memory between ticks.
  struct Memory {
    Vector nu;          // [rad/s]
    Vector e_previous;  // [rad]

    static constexpr std::tuple members{&Memory::nu, &Memory::e_previous};
  };

  MyLaw(Robot model, Gains gains, const controller::law::Settings& settings)
      : model_(std::move(model)), gains_(std::move(gains)), period_s_(settings.period_s) {}

  [[nodiscard]] Memory start(const Measurement& measurement,
                             const messages::ReferencePoint& reference) const {
    const Vector e = measurement.q - reference.q_ref;
    return {Vector::Zero(e.size()), e};
  }

  /// Computes the command; called once per period. The caller interpolates lost measurements.
  [[nodiscard]] controller::law::Step<Memory> step(
      const Memory& memory, const Measurement& measurement,
      const messages::ReferencePoint& reference) const {
    const Vector e = measurement.q - reference.q_ref;
    const Vector shrinks = (1 + gains_.a.array() * period_s_).inverse();
    const Vector nu =
        shrinks.cwiseProduct(memory.nu + gains_.b.cwiseProduct(e - memory.e_previous));
    controller::law::Step<Memory> result{{nu, e}, {}, {}};
    result.command.tau =
        robot::inverse_dynamics(model_, measurement.q, reference.v_ref, reference.a_ref) -
        gains_.kp.cwiseProduct(e) - gains_.kd.cwiseProduct(nu);
    result.signals = {signals.size(), {e, nu}};
    return result;
  }

 private:
  Robot model_;
  Gains gains_;
  double period_s_;
};

static_assert(controller::law::OutputFeedbackLaw<MyLaw>);

}  // namespace

int main(int argc, char** argv) { return run_controller<MyLaw>(argc, argv); }
