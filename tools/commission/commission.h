#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "identify/output_error.h"
#include "scenario/scenario.h"

/// Commissioning of an arm: signs and scale of its torques, the arm's own compensation of gravity
/// and friction, and delay. It uses small motions of the arm and measures positions only.
namespace tachless::commission {

/// The data of a run on the arm, one row per tick, in the scenario's coordinates.
struct Trial {
  Eigen::MatrixXd q;         ///< measured [rad; m]
  Eigen::MatrixXd tau;       ///< torque acting over the tick, including what the arm adds [N m; N]
  std::string stopped = {};  ///< why the run ended early; empty: it did not
  std::int64_t missed = 0;   ///< commands that did not arrive
  bool arm_is_clock = false;
};

/// A function that carries out a run of `scenario`, which is the commissioned scenario changed by
/// `overrides`.
using Trials = std::function<Trial(const scenario::Scenario& scenario,
                                   const std::vector<std::string>& overrides)>;

/// Reaction of an arm's drives to a tick without a command.
enum class Unsent { held, zeroed, ends_the_run };
constexpr std::array<std::string_view, 3> names(Unsent /*type*/) {
  return {"held", "zeroed", "ends_the_run"};
}

/// Findings of a commissioning.
struct Commissioned {
  /// The findings on one joint. An empty optional means not determined.
  struct Joint {
    std::string name, unit;
    std::optional<bool> turns{};    ///< whether it turns against robot.joint_signs
    std::optional<double> scale{};  ///< acting torque over sent torque
    double viscous = 0, dry = 0;    ///< friction as sent torque [N m s/rad; N s/m], [N m; N]
    std::optional<double> delay{};  ///< delay beyond the loop's own [ticks]
    double noise = 0;               ///< unexplained torque, rms below 15 Hz [N m; N]
  };

  std::vector<Joint> joints;
  std::optional<bool> adds_gravity, adds_friction;
  std::optional<int> delay;  ///< delay from reading to torque [ticks]
  std::optional<Unsent> unsent;
  std::string unsent_text;  ///< why the run ended when no torque was sent
  double delay_spread = 0;  ///< between the joints [ticks]
  std::int64_t missed = 0;  ///< missed commands
  bool arm_is_clock = false;
  double seconds = 0;                  ///< arm time
  std::vector<std::string> misfits;    ///< one line each: the misfit and its remedy
  bool mendable = true;                ///< `overrides` remove every misfit
  std::vector<std::string> overrides;  ///< changes of the scenario, as for --set
};

/// Commissions an arm with a sequence of short trials:
///
/// 1. A moment without torque. It is so short that gravity cannot accelerate a joint beyond a tenth
/// of its speed limit. 2. If the arm falls: a moment with gravity's torque, which checks the scale
/// of torque. 3. A run for each joint in turn, then a run of all joints: slow sines about the start
/// under a law with low gains. The law sends gravity's torque only if the arm fell. 4. If gravity
/// is determined: another run of all joints, in which a tenth of the torques is not sent.
///
/// The function explains the sent torques with the URDF's mechanics under all combinations of
/// signs, gravity and delay. It accepts the combination with the least residual if the margin to
/// the others is clear.
/// @throw base::Failure(bad_usage) when the arm cannot be moved safely or the joints are flexible
/// @throw base::Failure(protective_stop) when a joint runs away
/// @throw base::Failure(check_said_no) when the arm moves without torque, but not as gravity pulls
Commissioned commission(const scenario::Scenario& scenario, const Trials& trials,
                        const identify::Report& report);

std::string text(const Commissioned& found, const std::string& name);
void to_json(nlohmann::ordered_json& json, const Commissioned& found);

}  // namespace tachless::commission
