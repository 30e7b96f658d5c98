#pragma once

#include <Eigen/Core>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "identify/least_squares.h"
#include "identify/parameters.h"

namespace tachless::identify {

/// A payload in the frame of the link that carries it. Half widths are those of 95 % intervals;
/// they are infinite where the motion does not show the number.
struct Load {
  /// Components of an inertia, in the order of a robot's URDF.
  using Six = Eigen::Matrix<double, 6, 1>;

  std::string frame;
  double mass = 0, mass_half_width = 0;       ///< [kg]
  Eigen::Vector3d centre, centre_half_width;  ///< 0 where it is not shown [m]
  /// About the centre of mass: xx, xy, xz, yy, yz, zz [kg m2].
  Six inertia, inertia_half_width;
  /// The inertia is known to a third of its mean and is one that a body can have. Otherwise a point
  /// mass is written.
  bool inertia_shown = false;

  /// Returns the inertia that is written.
  [[nodiscard]] Six written_inertia() const { return inertia_shown ? inertia : Six::Zero().eval(); }
};

/// Returns the load among identified values.
/// @param precision of all values
Load load_of(const Precision& precision, const Eigen::VectorXd& values,
             const Parameters& parameters, const std::string& frame);

/// Returns the load as the scenario's plant.payload.
std::string override_of(const Load& load);

/// Returns lines with the load and its fields in the settings of robots' controllers.
std::string text(const Load& load);
void to_json(nlohmann::ordered_json& json, const Load& load);

}  // namespace tachless::identify
