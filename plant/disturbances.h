#pragma once

#include <vector>

#include "base/quantities.h"
#include "plant/spec.h"
#include "robot/model.h"

namespace tachless::plant {

/// The scenario's `plant.disturbances` (docs/plant.md) as torques on the links' joints. The torques
/// depend on the specs, the time and the links' position alone, and may jump in time.
class Disturbances {
 public:
  /// @param specs, model must outlive this object; the model has the joints and links of the specs.
  Disturbances(const std::vector<DisturbanceSpec>& specs, double period_s,
               const robot::Model& model);

  /// Returns the time of the first jump after `from_s`; `until_s` if no jump is before `until_s`.
  [[nodiscard]] double next_jump(double from_s, double until_s) const;
  /// Selects the disturbances for the time from `from_s` to `until_s`, in which there is no jump.
  void choose(double from_s, double until_s);
  /// Adds the torque at `time_s` and link position `q` to `tau` [N m].
  void add(double time_s, const Vector& q, Vector& tau) const;

  /// Returns the torque at `time_s`, the beginning of a tick [N m; N].
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
