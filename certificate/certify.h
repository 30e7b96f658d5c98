#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "certificate/feasibility.h"
#include "certificate/sampled_certificate.h"
#include "certificate/stability_certificate.h"

/// `tachless certify`: all that is known of a scenario before it is run, for people and as JSON.
namespace tachless::certificate {

struct Certificate {
  Feasibility feasibility;
  RobotConstants constants;
  std::optional<StabilityCertificate> stability;
  std::string no_stability;  ///< why not
  std::optional<SampledCertificate> sampled;
  std::string no_sampled;  ///< why not
};

/// @throw diagnostics::Failure(bad_usage) when law, robot or reference cannot be made of it.
Certificate certify(const experiment::Scenario& scenario, const OnProgress& tell = in_silence);

/// Why a run of it cannot do what it is to do: an unstable loop, torque or speed beyond a limit.
/// Empty when nothing stands against it.
std::vector<std::string> objections(const Certificate& certificate);

/// A page for people.
std::string page(const Certificate& certificate, const experiment::Scenario& scenario);

nlohmann::ordered_json to_json(const Certificate& certificate);

}  // namespace tachless::certificate
