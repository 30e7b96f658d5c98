#pragma once

#include <Eigen/Core>
#include <nlohmann/json_fwd.hpp>
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
    std::string doubt;  ///< why it is not identifiable; empty: it is
  };
  /// Of one joint, on the recordings or on data that was not used.
  struct Check {
    std::string joint, unit;
    double before, after;   ///< torque error, rms over the peak: all unknowns zero; identified
    double position_error;  ///< rms of measured minus simulated [rad; m]
    double correlation;     ///< of that from tick to tick: 0 is white
  };

  std::vector<Parameter> parameters;
  double condition = 0;
  std::vector<Check> checks;
  bool validated = false;  ///< `checks` are of data that was not used
  std::vector<std::string> overrides;
};

/// Least squares on filtered positions and torques, then output error of the closed loop.
/// @param validate recordings that are only checked; empty: the checks are of `recordings`
/// @throw diagnostics::Failure(bad_usage) for recordings of different robots
Identified identify(const std::vector<Recording>& recordings, const std::vector<Kind>& unknown,
                    const std::vector<Recording>& validate, const Report& report);

std::string text(const Identified& found, const std::string& name);
void to_json(nlohmann::ordered_json& json, const Identified& found);

}  // namespace tachless::identify
