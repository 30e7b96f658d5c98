#pragma once

#include <vector>

#include "base/quantities.h"
#include "plant/spec.h"
#include "robot/model.h"

namespace tachless::plant {

/// The scenario's `plant.disturbances` (docs/plant.md) as torques on the links' joints that no
/// drive gives. A function of the specs, the time and the links' position alone, with jumps.
class Disturbances {
 public:
  /// @param specs, model of which the joints and links are: both outlive this.
  Disturbances(const std::vector<DisturbanceSpec>& specs, double period_s,
               const robot::Model& model);

  /// The first jump after `from_s`, at `until_s` at the latest.
  [[nodiscard]] double next_jump(double from_s, double until_s) const;
  /// What is added from now on is of the time from `from_s` to `until_s`, inside which is no jump.
  void choose(double from_s, double until_s);
  /// Adds the torque at `time_s` and link position `q` to `tau` [N m].
  void add(double time_s, const Vector& q, Vector& tau) const;

  /// The torque at `time_s`, the beginning of a tick [N m; N].
  [[nodiscard]] Vector at(double time_s, const Vector& q);

 private:
  struct Source {
    const DisturbanceSpec* spec;
    int joint;  ///< -1: a force on a link
    bool active = false;
  };

  const robot::Model& model_;
  double period_s_;
  std::vector<Source> sources_;
};

}  // namespace tachless::plant
