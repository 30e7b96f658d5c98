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
    bool in_sum = false;  ///< the doubt: determined only together with others, as the links have it
  };
  /// A link with everything that is fixed to it.
  struct Link {
    std::string name;
    robot::MassProperties before, after;
  };
  /// Of one joint, on the recordings or on data that was not used.
  struct Check {
    std::string joint, unit;
    double before, after;  ///< torque error, rms over the peak: all unknowns zero; identified
    /// Of measured minus simulated positions, where the loop can be simulated: rms [rad; m], and
    /// the correlation from tick to tick: 0 is white.
    std::optional<double> position_error, correlation;
  };

  std::vector<Parameter> parameters;  ///< those of links are what is added to the URDF's
  std::vector<Link> links;            ///< empty: taken as the URDF has them
  Eigen::Index rank = 0;   ///< how many combinations of the parameters least squares determines
  bool simulated = false;  ///< the answer is output error's; otherwise that of least squares
  double condition = 0;
  std::vector<Check> checks;
  bool validated = false;  ///< `checks` are of data that was not used
  std::vector<std::string> overrides;
};

/// Least squares on filtered positions and torques; then, of recordings of known laws, output error
/// of the closed loop, which knows no offset.
/// @param validate a recording that is only checked; nothing: the checks are of the first of all
/// @throw base::Failure(bad_usage) for recordings of different robots, and when they show
/// none of `unknown`
Identified identify(const std::vector<Recording>& recordings, const std::vector<Kind>& unknown,
                    const std::optional<Recording>& validate, const Report& report);

/// The recording's URDF with the links that were found, which `robot::urdf_mechanics` reads.
std::string urdf_of(const Identified& found, const scenario::Scenario& scenario);

std::string text(const Identified& found, const std::string& name);
void to_json(nlohmann::ordered_json& json, const Identified& found);

}  // namespace tachless::identify
