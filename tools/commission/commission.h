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

/// What an arm does with the torque that it is sent, from its own small motions: signs, scale, what
/// it adds itself, delay. Positions alone are measured.
namespace tachless::commission {

/// What a run on the arm left, a row per tick, in the scenario's coordinates.
struct Trial {
  Eigen::MatrixXd q;    ///< measured [rad; m]
  Eigen::MatrixXd tau;  ///< given to the drives over the tick, what the arm adds included [N m; N]
  std::string stopped = {};  ///< why it ended early; empty: it did not
  std::int64_t missed = 0;   ///< commands that did not come
  bool arm_is_clock = false;
};

/// Carries out a run of `scenario`: the one that is commissioned, changed by `overrides`.
using Trials = std::function<Trial(const scenario::Scenario& scenario,
                                   const std::vector<std::string>& overrides)>;

/// What an arm's drives do in a tick for which nothing is sent.
enum class Unsent { held, zeroed, ends_the_run };
constexpr std::array<std::string_view, 3> names(Unsent /*type*/) {
  return {"held", "zeroed", "ends_the_run"};
}

struct Commissioned {
  /// Nothing: not determined.
  struct Joint {
    std::string name, unit;
    std::optional<bool> turns{};    ///< as the scenario says (robot.joint_signs), or against it
    std::optional<double> scale{};  ///< torque that acts per torque sent
    double viscous = 0, dry = 0;    ///< friction, in sent torque [N m s/rad; N s/m], [N m; N]
    std::optional<double> delay{};  ///< beyond the loop's own [ticks]
    double noise = 0;               ///< torque that nothing explains, rms below 15 Hz [N m; N]
  };

  std::vector<Joint> joints;
  std::optional<bool> adds_gravity, adds_friction;
  std::optional<int> delay;  ///< from the reading to the torque [ticks]
  std::optional<Unsent> unsent;
  std::string unsent_text;  ///< why the run ended
  double delay_spread = 0;  ///< between the joints [ticks]
  std::int64_t missed = 0;  ///< commands
  bool arm_is_clock = false;
  double seconds = 0;                  ///< of arm time
  std::vector<std::string> misfits;    ///< one line each: what does not fit, and the remedy
  bool mendable = true;                ///< `overrides` mend every misfit
  std::vector<std::string> overrides;  ///< what the scenario has to say, as for --set
};

/// A moment without torque, so short that gravity cannot make a joint faster than a tenth of its
/// limit, then a run for each joint in turn and two of all together: some slow sines about the
/// start, under a soft law whose gravity torque is sent only if the arm fell; in the last one a
/// tenth of the torques is not sent. Of signs, gravity,
/// and delay that combination is taken which explains the torques sent by the URDF's mechanics with
/// the least residual, if by a clear margin.
/// @throw base::Failure(bad_usage) where the arm cannot be moved safely or the joints are
/// flexible, (protective_stop) when a joint runs away
Commissioned commission(const scenario::Scenario& scenario, const Trials& trials,
                        const identify::Report& report);

std::string text(const Commissioned& found, const std::string& name);
void to_json(nlohmann::ordered_json& json, const Commissioned& found);

}  // namespace tachless::commission
