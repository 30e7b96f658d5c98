#pragma once

#include <vector>

#include "experiment/scenario.h"
#include "plant/arm.h"
#include "robot/model.h"

namespace tachless::plant {

/// The scenario's `plant.disturbances` (docs/plant.md) as torques on the joints. A function of the
/// scenario, the time and the links' position alone: noise is drawn by seed, tick and the number of
/// the disturbance.
class Disturbances final : public OutsideTorque {
 public:
  /// @param model of which the joints and links are; both outlive this.
  Disturbances(const experiment::Scenario& scenario, const robot::Model& model);

  [[nodiscard]] double next_jump(double from_s, double until_s) const override;
  void choose(double from_s, double until_s) override;
  void add(double time_s, const double* q, robot::Vector& tau) const override;

  /// The torque at `time_s`, the beginning of a tick [N m; N].
  [[nodiscard]] robot::Vector at(double time_s, const robot::Vector& q);

 private:
  struct Source {
    const DisturbanceSpec* spec;
    int joint;  ///< -1: a force on a link
    bool active = false;
    double noise = 0;
  };

  const robot::Model& model_;
  double period_s_;
  std::vector<Source> sources_;
};

}  // namespace tachless::plant
