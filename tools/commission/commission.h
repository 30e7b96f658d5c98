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
  Eigen::MatrixXd q;          ///< measured [rad; m]
  Eigen::MatrixXd tau;        ///< torque sent over the tick [N m; N]
  std::string stopped = {};   ///< why the run ended early; empty: it did not
  std::int64_t missed = 0;    ///< commands that did not arrive
  bool arm_is_clock = false;  ///< the arm's clock set the ticks, not the computer's
};

/// A function that carries out a run of `scenario`, which is the commissioned scenario changed by
/// `overrides`. The trial's torques include the torques that the arm adds according to `scenario`.
/// The function returns nothing if ticks were late or are missing. The arm may have moved by then.
/// The next run begins from its new position.
using Trials = std::function<std::optional<Trial>(const scenario::Scenario& scenario,
                                                  const std::vector<std::string>& overrides)>;

/// Reaction of an arm's drives to a tick without a command.
enum class Unsent { held, zeroed, ends_the_run };
constexpr std::array<std::string_view, 3> names(Unsent /*type*/) {
  return {"held", "zeroed", "ends_the_run"};
}

/// Findings of a commissioning. An empty optional means not determined.
struct Commissioned {
  /// The findings on one joint.
  struct Joint {
    std::string name, unit;
    std::optional<bool> answers{};  ///< true: its torque moves it by ten counts
    std::optional<bool> turns{};    ///< true: it turns against robot.joint_signs
    /// Acting torque over sent torque, if rotor, links and payload are as the scenario states.
    std::optional<double> scale{};
    /// Friction, in units of the sent torque [N m s/rad; N s/m], [N m; N].
    double viscous = 0, dry = 0;
    std::optional<double> delay{};  ///< delay beyond the loop's own [ticks]
    /// Rotor inertia that the trials assume if the scenario states none [kg m^2; kg].
    double assumed_rotor = 0;
    double noise = 0;  ///< unexplained torque, rms below 15 Hz [N m; N]
  };

  std::vector<Joint> joints;
  std::optional<bool> adds_gravity, adds_friction;
  std::optional<int> delay;  ///< delay from reading to torque [ticks]
  std::optional<Unsent> unsent;
  std::string unsent_text;  ///< why the run ended when no torque was sent
  double delay_spread = 0;  ///< largest less smallest delay of the joints [ticks]
  std::int64_t missed = 0;  ///< missed commands
  int repeated = 0;         ///< trials that were carried out again
  bool arm_is_clock = false;
  double seconds = 0;                  ///< arm time
  std::vector<std::string> misfits;    ///< one line each: the misfit and its remedy
  bool mendable = true;                ///< `overrides` remove every misfit
  std::vector<std::string> overrides;  ///< changes of the scenario, as for --set
};

/// Commissions an arm with a sequence of short trials. In each of them the plant's guards stop a
/// joint at a tenth of its speed limit, or 0.02 rad (m) from its reference.
///
/// 1. It sends no torque until a joint has moved by some counts, for a moment at most. 2. If the
/// arm fell, it sends a growing share of gravity's torque for a moment each, and checks signs and
/// scale of the torque. 3. It sends pulses of growing torque to one joint after the other, without
/// feedback, until each joint answers. 4. It moves each joint in turn, then all joints, by slow
/// sines about the start. A soft law follows the sines, and sends gravity's torque only if the arm
/// fell. 5. If gravity is determined, it moves all joints again and leaves out a tenth of the
/// torques.
///
/// The function explains the sent torques with the URDF's mechanics under all combinations of
/// signs, gravity and delay. It accepts the combination with the least residual if the margin to
/// the others is clear.
/// @throw base::Failure(bad_usage) when the joints are flexible, or for more than eight joints
/// @throw base::Failure(protective_stop) when a joint runs away for an unknown reason
/// @throw base::Failure(check_said_no) when ticks were late or missing again and again
Commissioned commission(const scenario::Scenario& scenario, const Trials& trials,
                        const identify::Report& report);

/// Returns the findings as text for people. @param name the scenario's name
std::string text(const Commissioned& found, const std::string& name);
/// Sets `json` to the findings. null stands for a number that is not determined.
void to_json(nlohmann::ordered_json& json, const Commissioned& found);

}  // namespace tachless::commission
