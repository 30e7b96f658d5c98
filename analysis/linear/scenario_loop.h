#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "controller/law/law.h"
#include "controller/stepped_law.h"
#include "linear/linear_loop.h"
#include "linear/sampled_limit.h"
#include "messages/measurements.h"
#include "messages/signals.h"
#include "reference/make_trajectory.h"
#include "robot/jet.h"
#include "scenario/scenario.h"

/// A scenario's closed loop, linearised: its plant (payload and friction included) about its
/// reference, and its law, whichever of the catalogue. Saturation, quantisation and noise are not
/// in it.
namespace tachless::linear {

/// The torques that a law of another program answers to measurements, tick by tick from the first
/// of a run at that period on, its reference held, with that reference's gains, in the scenario's
/// gravity or next to none. From one thread at a time.
using LawAnswers = std::function<std::vector<Vector>(double period_s, bool weightless,
                                                     std::span<const messages::AnyMeasurement>,
                                                     const messages::ReferencePoint&)>;

class ScenarioLoop {
 public:
  /// @param answers of the external law; empty: the law is one of the catalogue
  /// @throw base::Failure(bad_usage) when law, robot or reference cannot be made of it,
  /// NoLinearModel (of what follows too) when those answers are of no linear law.
  explicit ScenarioLoop(const scenario::Scenario& scenario, const LawAnswers& answers = {});

  /// The loop about a point of a motion, at any period. Precondition of this and of what follows:
  /// `controller::LawFacts::no_linearisation` is empty, or there are answers. Delays of
  /// measurement and command are added: only their sum matters.
  [[nodiscard]] SampledLoop at(const messages::ReferencePoint& reference) const;

  /// Returns the plant about a point of a motion, with another model in the place of its own.
  [[nodiscard]] LinearPlant plant_with(const robot::Model& model,
                                       const messages::ReferencePoint& reference) const;

  /// The law about rest there with these gains in place of the scenario's.
  [[nodiscard]] LinearLaw law_with(const std::map<std::string, Vector>& gains,
                                   const messages::ReferencePoint& reference) const;

  /// The law itself, not linearised, with the reference held at that point.
  [[nodiscard]] controller::SteppedLaw stepped(const messages::ReferencePoint& reference) const;

  /// The map of one period of the scenario from time t [s] on: the law at t, the plant half a
  /// period later. Precondition: no answers, whose states at two times need not be the same.
  [[nodiscard]] Eigen::MatrixXd map_at(double t_s) const;

  using Motion = reference::Motion;
  [[nodiscard]] const Motion& motion() const { return motion_; }
  [[nodiscard]] bool moves() const { return motion_.moves(); }
  /// At rest at the posture after that share of the motion, 0 … 1.
  [[nodiscard]] messages::ReferencePoint rest_at(double share) const;
  /// At rest at the postures of `Motion::instants`.
  [[nodiscard]] std::vector<messages::ReferencePoint> rest_points(int count) const;

  [[nodiscard]] const controller::law::Settings& settings() const { return settings_; }

 private:
  [[nodiscard]] LinearPlant plant(const messages::ReferencePoint& reference) const {
    return plant_with(model_, reference);
  }
  struct AskedLaw;

  std::shared_ptr<const scenario::Scenario> scenario_,
      weightless_;  ///< weightless: without gravity
  controller::law::Settings settings_;
  robot::Model model_;  ///< of the plant
  reference::Trajectory trajectory_;
  Motion motion_;
  std::shared_ptr<AskedLaw> asked_;
};

/// The robot as the plant has it: rotors of rigid joints and payload included.
/// @throw base::Failure(bad_usage) for a payload on no link.
robot::Model plant_of(const scenario::Scenario& scenario);

}  // namespace tachless::linear
