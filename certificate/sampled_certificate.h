#pragma once

#include <functional>
#include <optional>
#include <string_view>
#include <vector>

#include "certificate/sampled_limit.h"
#include "certificate/scenario_loop.h"

/// What is known of a scenario's sampled loop: of its linearisation about rest at postures of the
/// reference and elsewhere, and along the reference where it moves. Every number is of sampled
/// postures. It says nothing of large errors, saturation or quantisation.
namespace tachless::certificate {

/// Told what is being done; from one thread.
using OnProgress = std::function<void(std::string_view what)>;

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
  LoopSettings settings;
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
                                                      const OnProgress& on_progress = {});

/// Torque per measured angle of each joint's own position [N m/rad]; the larger one where link and
/// motor are both measured.
Eigen::VectorXd own_gain(const LinearLaw& law);

/// Per period over the motion, in `pieces` each of which stands for equally many periods.
double radius_over_motion(const ScenarioLoop& loop, int pieces,
                          std::vector<AlongPoint>* along = nullptr);

}  // namespace tachless::certificate
