#pragma once

#include <Eigen/Core>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "identify/least_squares.h"
#include "identify/parameters.h"

namespace tachless::identify {

/// Payload in the frame of the link that carries it. A half width is half a 95 % interval. It is
/// infinite if the motion does not determine the number.
struct Load {
  /// Components of an inertia, in the order of a robot's URDF.
  using Six = Eigen::Matrix<double, 6, 1>;

  std::string frame;                          ///< name of the link that carries the payload
  double mass = 0, mass_half_width = 0;       ///< [kg]
  Eigen::Vector3d centre, centre_half_width;  ///< [m]; 0 where the motion does not determine it
  /// About the centre of mass: xx, xy, xz, yy, yz, zz [kg m2].
  Six inertia, inertia_half_width;
  /// True if a body can have this inertia, and each half width is below a third of the mean of the
  /// principal moments. Otherwise overrides and texts describe a point mass.
  bool inertia_shown = false;

  /// Returns the inertia for overrides and texts: `inertia` or zero.
  [[nodiscard]] Six written_inertia() const { return inertia_shown ? inertia : Six::Zero().eval(); }
};

/// Returns the load among identified values, which `identify` estimates (output_error.h,
/// least_squares.h).
/// @param precision half widths and correlation of all `values`
/// @param frame link that carries the load
Load load_of(const Precision& precision, const Eigen::VectorXd& values,
             const Parameters& parameters, const std::string& frame);

/// Returns the setting "plant.payload={…}" that writes the load into a scenario.
std::string override_of(const Load& load);

/// Returns lines with the load, and with the same load in the formats of robot manufacturers'
/// controllers.
std::string text(const Load& load);
void to_json(nlohmann::ordered_json& json, const Load& load);

}  // namespace tachless::identify
