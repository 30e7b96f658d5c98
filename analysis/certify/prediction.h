#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "linear/effort.h"
#include "linear/missed_ticks.h"
#include "linear/sampled_limit.h"
#include "linear/scenario_loop.h"

/// Prediction of a scenario's sampled loop by its linearisation: about rest at postures of the
/// reference, and along the reference where it moves. A search refines the worst posture. Large
/// errors, saturation and quantisation are not covered. `certify`, `design`, `run` and the report
/// all take their numbers from here.
namespace tachless::certify {

/// Number of postures of the reference. The search for a worse posture begins at the worst of them.
inline constexpr int reference_postures = 17;

struct Prediction {
  std::string unknown;      ///< why the law cannot be linearised; empty: it can, and the rest holds
  std::string not_counted;  ///< parts of the emulated arm that no number covers; empty: none
  controller::law::Settings settings;

  /// True if the errors of the linearised loop decay at the scenario's period. A motion that
  /// repeats, or that the run cuts off, is judged as a whole. Any other motion is judged at rest at
  /// its end. A posture on the way may be unstable at rest: eigenvalues at frozen postures are
  /// neither necessary nor sufficient for a moving reference.
  bool stable = false;
  /// Spectral radius per period. A motion that repeats after n periods has the n-th root of the
  /// radius of the product of its one-period maps. A motion that ends in the run has the radius at
  /// rest at its end. A motion that is cut off has the larger of both. A law known by its answers
  /// has the largest radius at rest at the reference's postures.
  double radius = 0;
  /// Factor by which errors grow over a motion that ends in the run, before they decay. It is the
  /// spectral radius of the product of the motion's one-period maps; 0 if this radius is not above
  /// 1.
  double growth = 0;
  Vector unstable_q;  ///< a posture of the reference that is unstable at rest; empty: none
  /// Largest period at which the loop is stable at rest at all postures [s]; nothing: no period is
  /// stable.
  std::optional<double> limit_s;
  Vector limit_q;       ///< the posture that binds it
  linear::Modes modes;  ///< at the posture with the largest radius
  /// Largest torque per angle that the joint itself measures, over the postures.
  Eigen::VectorXd gain_Nm_per_rad;
  Vector stiffness;  ///< least torque on the link per position error at rest, over the postures
  /// Unit of the gain and of the stiffness; with prismatic joints "N m/rad (N/m)".
  std::string_view stiffness_unit = "N m/rad";
  std::string_view torque_unit = "N m";  ///< unit of `count_Nm`; with prismatic joints "N m (N)"
  /// Largest |K^-1| F_c over the postures, with K the stiffness of all joints together. Dry
  /// friction may hold a joint at rest within this error [rad; m]. Empty without friction.
  Vector rest_error;
  std::optional<Eigen::VectorXd> count_Nm;  ///< torque per encoder count; nothing: ideal encoder
  /// The least of each margin over the postures. Nothing: with quick effort, or where a posture is
  /// unstable.
  std::optional<linear::Margins> margins;
  Vector margin_q;                            ///< the posture with the least modulus margin
  std::optional<linear::MissedTicks> missed;  ///< nothing: without full effort, or without margins
};

/// Returns the prediction of a scenario.
/// @param answers of the scenario's law if it is external; without them its loop is not known
/// @throw base::Failure(bad_usage) when law, robot or reference cannot be made of the scenario.
Prediction analyse(const scenario::Scenario& scenario, linear::Effort effort,
                   const linear::OnProgress& on_progress = linear::no_progress,
                   const linear::LawAnswers& answers = {});

/// Returns a posture that a search ended at, with exactly 0 for entries that are nearly 0.
Vector found_posture(const Vector& q);

/// Returns the torque per measured angle of each joint's own position [N m/rad]. If link and motor
/// are both measured, it is the larger one.
Eigen::VectorXd own_gain(const linear::LinearLaw& law);

/// Returns the torque per position error at rest, of each joint alone: the least over postures of
/// the reference [N m/rad; N/m]. For a joint with dry friction it is F_c over
/// Prediction::rest_error. This quotient is smaller if gains couple joints. An integral's growth
/// with time is left out. Empty for a law that cannot be linearised.
/// @throw as `analyse`.
Vector stiffness(const scenario::Scenario& scenario);

/// Returns why no region of the loop in continuous time is shown: the sampled loop is unstable, or
/// its errors grow over the motion. Empty: it may be shown.
std::string no_region(const Prediction& prediction);

/// Returns e.g. "errors double in 12 ms", of an unstable loop.
std::string growth_text(const Prediction& prediction);

/// Returns e.g. "stable at 1 kHz with 1 tick of delay: limit 3.6 ms, settles in 0.2 s", "unstable
/// at 1 kHz …".
std::string text(const Prediction& prediction);

/// Returns a round period below the limit and the scenario's period; nothing: no period is stable.
std::optional<double> stable_period(const Prediction& prediction);

/// Returns why a run of an unstable loop is refused, with the limit and a command with a stable
/// period.
std::string refusal(const Prediction& prediction, const std::string& scenario_file);

// ---- the numbers as text -----------------------------------------------------------------------

std::string limit_text(const std::optional<double>& limit_s);
std::string settling_text(double seconds);
/// Returns e.g. "gain 3.5, phase 50 deg, delay 4.1 ms"; "gain 0.62 to 30, …" where a smaller gain
/// is unstable too.
std::string margins_text(const linear::Margins& margins);
/// Returns e.g. "0.61 (common to all torques), 0.45 (independent)".
std::string modulus_text(const linear::Margins& margins);
/// Returns e.g. "any pattern of at most 12 in a row is stable (searched, not proved)".
std::string pattern_text(int in_a_row);
/// Returns the same for commands, with "; the repeated pattern of 21 missed and 4 received is
/// unstable".
std::string missed_text(const linear::MissedTicks& missed);
/// Returns a sentence about the errors at which dry friction may hold the joints; empty without
/// friction.
std::string friction_text(const Prediction& prediction);
/// Returns e.g. "[1.2, 3]".
std::string list_text(const Eigen::VectorXd& values);

}  // namespace tachless::certify
