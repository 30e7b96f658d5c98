#pragma once

#include <Eigen/Core>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "identify/output_error.h"
#include "identify/parameters.h"
#include "identify/recording.h"

namespace tachless::identify {

struct Identified {
  struct Parameter {
    Parameters::Entry entry;
    double value, half_width;
    std::string doubt;    ///< why it is not identifiable; empty: it is
    bool in_sum = false;  ///< the parameter is determined only in a sum with others
  };
  /// A link together with everything that is fixed to it.
  struct Link {
    std::string name;
    robot::MassProperties before, after;
  };
  /// The check of one joint, on the first recording or on data that was not used.
  struct Check {
    std::string joint, unit;
    /// Rms torque error over the peak torque, with all unknowns zero and with the identified
    /// values.
    double before, after;
    /// Measured minus simulated positions, if the loop can be simulated: rms [rad; m], and the
    /// correlation from one tick to the next. Correlation 0 means white noise.
    std::optional<double> position_error, correlation;
  };

  std::vector<Parameter> parameters;  ///< link parameters are differences to the URDF's values
  std::vector<Link> links;            ///< empty if the links are those of the URDF
  Eigen::Index rank = 0;   ///< number of parameter combinations that least squares determines
  bool simulated = false;  ///< the answer is from output error; otherwise from least squares
  double condition = 0;
  std::vector<Check> checks;
  bool validated = false;  ///< `checks` use data that was not used to identify
  std::vector<std::string> overrides;
};

/// Identifies the unknown parameters. The first step is least squares on filtered positions and
/// torques. For recordings of known laws, output error of the closed loop follows; it has no
/// offsets.
/// @param validate a recording used only for the checks; nothing: the checks use the first
/// recording
/// @throw base::Failure(bad_usage) for recordings of different robots, and when no parameter of
/// `unknown` is left to identify
Identified identify(const std::vector<Recording>& recordings, const std::vector<Kind>& unknown,
                    const std::optional<Recording>& validate, const Report& report);

/// Returns the recording's URDF with the identified links. `robot::urdf_mechanics` reads it.
std::string urdf_of(const Identified& found, const scenario::Scenario& scenario);

std::string text(const Identified& found, const std::string& name);
void to_json(nlohmann::ordered_json& json, const Identified& found);

}  // namespace tachless::identify
