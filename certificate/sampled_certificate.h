#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "certificate/sampled_limit.h"
#include "certificate/scenario_loop.h"

/// What is known of a scenario's sampled loop: of its linearisation about rest at postures of the
/// reference and elsewhere, and along the reference where it moves. Every number is of sampled
/// postures. It says nothing of large errors, saturation or quantisation. The verdict is a part of
/// it that takes well under 0.1 s, for every run.
namespace tachless::certificate {

/// Told what is being done; from one thread.
using OnProgress = std::function<void(std::string_view what)>;
inline void in_silence(std::string_view /*what*/) {}

struct FilterLimits {
  controller::law::Discretisation filter;
  std::optional<double> delay_0_s, delay_1_s;  ///< nothing: unstable at any period
};

struct PeriodMargin {
  double period_s = 0, modulus = 0, radius = 0;
};

struct AlongPoint {
  double t_s = 0, radius = 0;  ///< of the one-period map there
};

struct SampledCertificate {
  controller::law::Settings settings;
  bool has_filter = true;  ///< whether the kind of filter makes a difference
  bool stable = false;     ///< at every posture of the reference, and along it
  /// Of the scenario's filter and delay, over postures of the reference; nothing: unstable at any.
  std::optional<double> limit_s;
  robot::Vector limit_q;  ///< the posture that binds
  std::vector<FilterLimits> limits;
  /// The scenario's filter and delay over all postures of the robot.
  std::optional<double> anywhere_limit_s;
  robot::Vector anywhere_q;
  int anywhere_postures = 0;
  Modes modes;      ///< at the posture of the reference with the largest radius
  Margins margins;  ///< at the posture that binds the limit
  /// Per period over the motion: the root of the spectral radius of the product of its one-period
  /// maps; at rest that of the one map.
  double radius_along = 0;
  std::vector<AlongPoint> along;            ///< empty at rest
  std::vector<PeriodMargin> by_period;      ///< up to beyond the limit
  Eigen::VectorXd gain_Nm_per_rad;          ///< torque per measured angle, each joint's own
  std::optional<Eigen::VectorXd> count_Nm;  ///< torque per encoder count; nothing: ideal encoder
};

/// Nothing when the law cannot be linearised.
std::optional<SampledCertificate> sampled_certificate(const experiment::Scenario& scenario,
                                                      const OnProgress& on_progress = in_silence);

/// Torque per measured angle of each joint's own position [N m/rad]; the larger one where link and
/// motor are both measured.
Eigen::VectorXd own_gain(const LinearLaw& law);

/// "9.71e-05 s", "3.6 ms": a period for people.
std::string period_text(double seconds);

struct Verdict {
  std::string unknown;  ///< why the law cannot be linearised; empty: it can, and the rest holds
  bool stable = false;  ///< of the linearised loop at the scenario's period
  double period_s = 0;
  int delay = 0;
  std::optional<double> limit_s;  ///< largest stable period that was found; nothing: none
  double phase_margin_deg = 0;    ///< of a stable loop
  double settles_s = 0;           ///< to 1 % of an error in all joints
  double growth_per_s = 0;        ///< of an unstable loop
};

/// @throw diagnostics::Failure(bad_usage) when law, robot or reference cannot be made of it.
Verdict verdict(const experiment::Scenario& scenario);

/// "stable at 1 kHz: limit 3.6 ms, phase margin 50°, settles in 0.2 s", "unstable at 1 kHz: …".
std::string text(const Verdict& verdict);

/// Why a run is refused, and what to type: limit, a stable period nearby. Of an unstable loop.
std::string refusal(const Verdict& verdict, const std::string& scenario_file);

}  // namespace tachless::certificate
