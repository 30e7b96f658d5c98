#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "certificate/linear_loop.h"
#include "certificate/sampled_limit.h"
#include "experiment/scenario.h"
#include "loop/signals.h"
#include "reference/make_trajectory.h"
#include "robot/jet.h"

/// A scenario's closed loop, linearised: its plant (payload and friction included) about its
/// reference, and its law, whichever of the catalogue. Saturation, quantisation and noise are not
/// in it.
namespace tachless::certificate {

/// How the law runs, where that is to differ from the scenario.
struct LoopSettings {
  controller::law::Discretisation filter = controller::law::Discretisation::first_order_hold;
  int delay = 0;
  double period_s = 1e-3;
};
LoopSettings settings_of(const experiment::Scenario& scenario);

class ScenarioLoop {
 public:
  /// @throw diagnostics::Failure(bad_usage) when law, robot or reference cannot be made of it.
  explicit ScenarioLoop(const experiment::Scenario& scenario);

  /// The loop about a point of a motion, at any period. Precondition of this and of what follows:
  /// `controller::LawFacts::no_linearisation` is empty.
  [[nodiscard]] SampledLoop at(const loop::ReferencePoint& reference) const {
    return at(reference, settings_);
  }
  [[nodiscard]] SampledLoop at(const loop::ReferencePoint& reference,
                               const LoopSettings& settings) const;

  /// The map of one period of the scenario from time t [s] on: the law at t, the plant half a
  /// period later.
  [[nodiscard]] Eigen::MatrixXd map_at(double t_s) const;

  /// What repeats of the reference: one period of a sinusoid, otherwise the whole run [s].
  [[nodiscard]] double span_s() const { return span_s_; }
  [[nodiscard]] bool moves() const { return moves_; }
  [[nodiscard]] loop::ReferencePoint reference(double t_s) const { return trajectory_.at(t_s); }
  /// At rest at postures of the reference: the first, the last and evenly between; one when it does
  /// not move.
  [[nodiscard]] std::vector<loop::ReferencePoint> rests(int count) const;

  [[nodiscard]] const robot::Model& model() const { return model_; }
  [[nodiscard]] const LoopSettings& settings() const { return settings_; }

 private:
  [[nodiscard]] LinearPlant plant(const loop::ReferencePoint& reference) const;

  std::shared_ptr<const experiment::Scenario> scenario_;
  LoopSettings settings_;
  robot::Model model_;  ///< of the plant
  reference::Trajectory trajectory_;
  double span_s_ = 0;
  bool moves_ = false;
};

/// The robot as the plant has it: rotors of rigid joints and payload included.
/// @throw diagnostics::Failure(bad_usage) for a payload on no link.
robot::Model plant_of(const experiment::Scenario& scenario);

/// At rest in `q`.
loop::ReferencePoint held_at(const robot::Vector& q);

/// Inverse dynamics of the links on the reference, with its first two derivatives in time [N m; N].
robot::JetVector torque_on(const robot::Model& links, const loop::ReferencePoint& reference);

}  // namespace tachless::certificate
