#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "certificate/linear_loop.h"
#include "certificate/sampled_limit.h"
#include "controller/law/law.h"
#include "controller/stepped_law.h"
#include "experiment/scenario.h"
#include "loop/measurements.h"
#include "loop/signals.h"
#include "reference/make_trajectory.h"
#include "robot/jet.h"

/// A scenario's closed loop, linearised: its plant (payload and friction included) about its
/// reference, and its law, whichever of the catalogue. Saturation, quantisation and noise are not
/// in it.
namespace tachless::certificate {

/// The torques that a law of another program answers to measurements, tick by tick from the first
/// of a run at that period on, its reference held, with that reference's gains, in the scenario's
/// gravity or next to none. From one thread at a time.
using LawAnswers = std::function<std::vector<robot::Vector>(double period_s, bool weightless,
                                                            std::span<const loop::AnyMeasurement>,
                                                            const loop::ReferencePoint&)>;

class ScenarioLoop {
 public:
  /// @param answers of the external law; empty: the law is one of the catalogue
  /// @throw diagnostics::Failure(bad_usage) when law, robot or reference cannot be made of it,
  /// NoLinearModel (of what follows too) when those answers are of no linear law.
  explicit ScenarioLoop(const experiment::Scenario& scenario, const LawAnswers& answers = {});

  /// The loop about a point of a motion, at any period. Precondition of this and of what follows:
  /// `controller::LawFacts::no_linearisation` is empty, or there are answers. Round the loop it is
  /// the same whether the measurement or the torque is late.
  [[nodiscard]] SampledLoop at(const loop::ReferencePoint& reference) const;

  /// The law about rest there with these gains in place of the scenario's.
  [[nodiscard]] LinearLaw law_with(const std::map<std::string, robot::Vector>& gains,
                                   const loop::ReferencePoint& reference) const;

  /// The law itself, not linearised, with the reference held at that point.
  [[nodiscard]] controller::SteppedLaw stepped(const loop::ReferencePoint& reference) const;

  /// The map of one period of the scenario from time t [s] on: the law at t, the plant half a
  /// period later. Precondition: no answers, whose states at two times need not be the same.
  [[nodiscard]] Eigen::MatrixXd map_at(double t_s) const;

  using Motion = reference::Motion;
  [[nodiscard]] const Motion& motion() const { return motion_; }
  [[nodiscard]] bool moves() const { return motion_.moves(); }
  /// At rest at the posture after that share of the motion, 0 … 1.
  [[nodiscard]] loop::ReferencePoint rest_at(double share) const;
  /// At rest at the postures of `Motion::instants`.
  [[nodiscard]] std::vector<loop::ReferencePoint> rest_points(int count) const;

  [[nodiscard]] const controller::law::Settings& settings() const { return settings_; }

 private:
  [[nodiscard]] LinearPlant plant(const loop::ReferencePoint& reference) const;
  struct AskedLaw;

  std::shared_ptr<const experiment::Scenario> scenario_;
  controller::law::Settings settings_;
  robot::Model model_;  ///< of the plant
  reference::Trajectory trajectory_;
  Motion motion_;
  std::shared_ptr<AskedLaw> asked_;
};

/// The robot as the plant has it: rotors of rigid joints and payload included.
/// @throw diagnostics::Failure(bad_usage) for a payload on no link.
robot::Model plant_of(const experiment::Scenario& scenario);

}  // namespace tachless::certificate
