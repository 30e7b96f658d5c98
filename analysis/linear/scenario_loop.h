#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "controller/law/law.h"
#include "controller/law_socket.h"
#include "controller/stepped_law.h"
#include "linear/linear_loop.h"
#include "linear/sampled_limit.h"
#include "messages/measurements.h"
#include "messages/signals.h"
#include "reference/make_trajectory.h"
#include "robot/jet.h"
#include "scenario/drive_loop.h"
#include "scenario/scenario.h"

/// Linearised closed loop of a scenario: its plant about its reference, and its law. The law is any
/// law of the catalogue, or an external law. The plant includes payload and friction. Saturation,
/// quantisation and noise are left out.
namespace tachless::linear {

/// Function that returns the torques with which a law of another program answers measurements, tick
/// by tick from the first tick of a run. The reference and its gains are constant. One thread at a
/// time calls the function.
using LawAnswers = std::function<std::vector<Vector>(double period_s, controller::Gravity,
                                                     std::span<const messages::AnyMeasurement>,
                                                     const messages::ReferencePoint&)>;

class ScenarioLoop {
 public:
  /// @param answers of the external law; empty: the law is in the catalogue
  /// @throw base::Failure(bad_usage) when law, robot or reference cannot be made of the scenario
  /// @throw NoLinearModel, also by the functions below, when no linear law gives these answers.
  explicit ScenarioLoop(const scenario::Scenario& scenario, const LawAnswers& answers = {});

  /// Returns the loop about a point of a motion, for any period. Delays of measurement and command
  /// are added: only their sum matters. Precondition of this function and of the functions below:
  /// `controller::LawFacts::no_linearisation` is empty, or `answers` was given.
  [[nodiscard]] SampledLoop at(const messages::ReferencePoint& reference) const;

  /// Returns the plant about a point of a motion, with `model` in place of the scenario's model.
  [[nodiscard]] LinearPlant plant_with(const robot::Model& model,
                                       const messages::ReferencePoint& reference) const;

  /// Returns the law linearised at rest, with these gains in place of the scenario's gains.
  [[nodiscard]] LinearLaw law_with(const std::map<std::string, Vector>& gains,
                                   const messages::ReferencePoint& reference) const;

  /// Returns the law itself, not linearised, with the reference held at that point.
  [[nodiscard]] controller::SteppedLaw stepped(const messages::ReferencePoint& reference) const;

  /// Returns the map of one period of the scenario from time t [s] on: the law at t, the plant half
  /// a period later. Precondition: no `answers` were given. Models made of answers at two times
  /// need not have the same states.
  [[nodiscard]] Eigen::MatrixXd map_at(double t_s) const;

  using Motion = reference::Motion;
  [[nodiscard]] const Motion& motion() const { return motion_; }
  [[nodiscard]] bool moves() const { return motion_.moves(); }
  /// Returns rest at the posture after that share of the motion, 0 to 1.
  [[nodiscard]] messages::ReferencePoint rest_at(double share) const;
  /// Returns rest at the postures of `Motion::instants`.
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
  robot::Model model_;                                 ///< of the plant
  std::optional<scenario::DriveLoopSpec> drive_loop_;  ///< of plant.drive.loop
  reference::Trajectory trajectory_;
  Motion motion_;
  std::shared_ptr<AskedLaw> asked_;
};

/// Returns the robot as the plant has it, with the rotors of rigid joints and the payload.
/// @throw base::Failure(bad_usage) if the robot has no link of the payload's name
robot::Model plant_of(const scenario::Scenario& scenario);

}  // namespace tachless::linear
