#pragma once

#include <Eigen/Core>
#include <cmath>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "identify/load.h"
#include "identify/misfit.h"
#include "identify/output_error.h"
#include "identify/parameters.h"
#include "identify/recording.h"

namespace tachless::identify {

/// Result of an identification.
struct Identified {
  struct Parameter {
    Parameters::Entry entry;
    /// In the unit of `entry`. `half_width` is half a 95 % interval. If `at_bound`, the value is
    /// zero, and the true value is at most `half_width`.
    double value, half_width;
    std::string doubt;      ///< why it is not identifiable; empty: it is
    bool in_sum = false;    ///< the parameter is determined only in a sum with others
    bool at_bound = false;  ///< the value is zero because it cannot be negative
    /// The value is determined mainly by the URDF's links and not by the recordings: without what
    /// the URDF tells of the links' numbers its standard deviation would more than double.
    bool by_urdf = false;

    /// Returns whether the parameter is known to be small but cannot be distinguished from zero.
    [[nodiscard]] bool is_small() const {
      return doubt.empty() && entry.not_negative && std::abs(value) <= half_width;
    }
  };
  /// A link together with everything that is fixed to it.
  struct Link {
    std::string name;
    robot::MassProperties before, after;  ///< of the URDF, and identified
  };
  /// Check of one joint on the recording with the largest error. If `validated`, that recording was
  /// not used to identify.
  struct Check {
    std::string joint, unit;
    /// Rms torque error over the peak torque, with all unknowns zero and with the identified
    /// values.
    double before, after;
    /// Rms of measured minus simulated positions, if the loop can be simulated [rad; m].
    std::optional<double> position_error;
    /// Difference between the joint's model and the recordings that were used (misfit.h).
    Misfit misfit;
  };

  std::vector<Parameter> parameters;  ///< link parameters are differences to the URDF's values
  std::optional<Load> load;
  std::vector<Link> links;  ///< empty if the URDF's links are unchanged
  Eigen::Index rank = 0;    ///< number of parameter combinations that least squares determines
  bool simulated = false;   ///< the answer is from output error; otherwise from least squares
  double condition = 0;     ///< condition number of the (scaled) least-squares problem
  std::vector<Check> checks;
  bool validated = false;  ///< `checks` use data that was not used to identify
  /// Why the recordings do not fit the robot, and what would make them fit; empty: they fit.
  std::string no_fit;
  std::vector<std::string> advice;  ///< what a recording of the doubtful parameters needs
  /// Settings "key=value" that write the values into the scenario.
  std::vector<std::string> overrides;
};

/// Identifies the unknown parameters. The first step is least squares on filtered positions and
/// torques. If all recordings are of known laws, output error of the closed loop follows. Torque
/// offsets are then not identified, because a log has the torques that were sent.
/// @param validate a recording used only for the checks; nothing: the checks use all recordings
/// @throw base::Failure(bad_usage) for recordings of different robots, and when no parameter of
/// `unknown` is left to identify
Identified identify(const std::vector<Recording>& recordings, const std::vector<Kind>& unknown,
                    const std::optional<Recording>& validate, const Report& report);

/// Returns the URDF's text of the scenario with the identified links.
std::string urdf_of(const Identified& found, const scenario::Scenario& scenario);

/// Returns a text with the values, their intervals, the checks and the advice.
/// @param name title of the text
std::string text(const Identified& found, const std::string& name);
void to_json(nlohmann::ordered_json& json, const Identified& found);

}  // namespace tachless::identify
