#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

/// Shapes of a robot's links.
namespace tachless::robot {

/// Part of a link: the points within `radius` of a segment.
struct Capsule {
  std::string link;          ///< URDF link that it moves with
  Eigen::Vector3d from, to;  ///< ends of the segment [m]
  double radius;             ///< [m]
};

/// Returns capsules about the shapes of a URDF's links, in the links' frames. They contain the
/// spheres, boxes, cylinders and capsules of a link's <collision> elements. For a link without such
/// a shape they contain those of its <visual> elements. Meshes are not read.
/// @throw std::invalid_argument for malformed XML and for sizes and origins that are no numbers
std::vector<Capsule> link_capsules(const std::string& urdf);

/// Returns the distance of two capsules in one frame [m]. It is negative if they overlap.
double distance(const Capsule& a, const Capsule& b);

}  // namespace tachless::robot
