#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "robot/link_shapes.h"
#include "scenario/scenario.h"

namespace tachless::identify {

/// Distances between the links of a robot. The shapes are capsules about the primitives in its URDF
/// (robot/link_shapes.h). The shapes of one body and of two bodies that a joint connects are not
/// compared. Two links whose shapes meet at the start are not compared either, because capsules are
/// larger than the shapes.
class Separation {
 public:
  /// Two links and their distance [m].
  struct Pair {
    std::string a, b;
    double distance;
  };

  /// @param urdf text of the robot's URDF with its shapes
  /// @throw std::invalid_argument as `robot::link_capsules`
  Separation(const scenario::Scenario& scenario, const std::string& urdf);

  /// Returns the two links that are nearest to each other at positions `q`; nothing if none are
  /// compared.
  [[nodiscard]] std::optional<Pair> nearest(const Vector& q) const;

  /// Returns the pairs of links that are not compared because their shapes meet at the start.
  [[nodiscard]] const std::vector<Pair>& meeting() const { return meeting_; }

 private:
  using Compared = std::vector<std::pair<std::size_t, std::size_t>>;

  [[nodiscard]] std::vector<robot::Capsule> placed(const Vector& q) const;

  const robot::Model& model_;
  std::vector<robot::Capsule> capsules_;  ///< in the frames of their links
  Compared compared_;                     ///< indices of capsules
  std::vector<Pair> meeting_;
};

}  // namespace tachless::identify
