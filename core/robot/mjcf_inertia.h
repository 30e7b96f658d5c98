#pragma once

#include "robot/mjcf_document.h"
#include "robot/model.h"

/// Masses of an MJCF's bodies, in the axes and at the origin of the body's frame.
namespace tachless::robot {

/// Returns the properties that an <inertial> gives.
MassProperties mass_of_inertial(const MjcfDocument& document, const MjcfAttributes& inertial);

/// Returns whether a geom adds to the mass of a body without <inertial>.
bool has_mass(const MjcfDocument& document, const MjcfAttributes& geom);

/// A primitive geom: its place in its frame, and its sizes as MuJoCo orders them.
struct MjcfShape {
  std::string type;
  MjcfPose pose;
  Eigen::Vector3d size;  ///< radii, half lengths [m]
};

/// Returns the place and sizes of a geom, `fromto` resolved. Sizes are 0 for a type that is no
/// sphere, capsule, ellipsoid, cylinder or box.
MjcfShape shape_of(const MjcfDocument& document, const MjcfAttributes& geom);

/// Returns the properties of a geom that `has_mass`, in the frame in which the geom is placed.
/// @throw std::invalid_argument for a mesh and other shapes whose volume is not known
MassProperties mass_of_geom(const MjcfDocument& document, const MjcfAttributes& geom);

/// Returns the properties after applying the bounds and the balance of <compiler>.
MassProperties corrected(const MjcfDocument& document, MassProperties body);

}  // namespace tachless::robot
