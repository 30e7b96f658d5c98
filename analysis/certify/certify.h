#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "certify/drive_prediction.h"
#include "certify/feasibility.h"
#include "certify/prediction.h"
#include "lyapunov/global_convergence.h"
#include "lyapunov/sampled_region.h"
#include "lyapunov/stability_certificate.h"
#include "lyapunov/weighted_region.h"

/// `tachless certify`: the analysis of a scenario before it runs, for people and as JSON.
namespace tachless::certify {

struct Certificate {
  Prediction loop;
  std::optional<int> max_missed{};  ///< loop.max_missed of a realtime scenario
  Feasibility feasibility;
  std::optional<lyapunov::StabilityCertificate> stability;  ///< nothing for an unstable loop
  std::optional<lyapunov::PaperConditions> paper;           ///< where it was asked for
  std::string no_stability;                                 ///< why there is no region
  std::optional<lyapunov::WeightedRegion> weighted;         ///< the region of the other laws
  /// Largest error of each joint that its range allows at the start [rad; m]; half a turn for a
  /// joint without limits. No region is shown beyond this error. Empty: not known.
  Eigen::VectorXd start_range;
  /// The answer whether every start converges; nothing: not known of this law, or not examined.
  std::optional<lyapunov::GlobalConvergence> global;
  std::optional<lyapunov::SampledRegion> nonlinear;  ///< where it was asked for
  std::string no_nonlinear;                          ///< why there is none; empty: not asked for
  /// Nothing: without plant.drive.loop, or for an unstable loop.
  std::optional<DrivePrediction> drives;
};

struct CertifyOptions {
  bool full = false;   ///< adds the region of the sampled loop, and missed ticks also in lockstep
  bool paper = false;  ///< adds the conditions that Loria and Ortega (1995) print
  linear::LawAnswers answers = {};  ///< as for `analyse`
  linear::OnProgress tell = linear::no_progress;
};

/// Analyses a scenario before it runs.
/// @throw base::Failure(bad_usage) when law, robot or reference cannot be made of the scenario.
Certificate certify(const scenario::Scenario& scenario, const CertifyOptions& options = {});

/// Returns the result of `lyapunov::certified_run`; nothing for a sampled loop for which
/// `no_region` gives a reason.
std::optional<lyapunov::CertifiedRun> certified_run(const scenario::Scenario& scenario);

/// Returns the reasons why a run must fail: an unstable loop, torque or speed beyond a limit.
std::vector<std::string> objections(const Certificate& certificate);

/// Returns the text for people: five lines, and the paper's conditions where they were asked for.
/// @param full all numbers of the JSON in its order, instead of the five lines
std::string page(const Certificate& certificate, const scenario::Scenario& scenario, bool full);
/// Returns all numbers as JSON. null stands for an infinite or missing number.
nlohmann::ordered_json to_json(const Certificate& certificate);
/// Returns `start` of the group `region` of that JSON, and of summary.json. `certified` is null
/// where it is not decided.
nlohmann::ordered_json to_json(const lyapunov::CertifiedStart& start);
/// Returns the group `sampled` of that JSON, with the line for people as `text`. The margins are
/// absent with less effort.
nlohmann::ordered_json to_json(const Prediction& prediction);

}  // namespace tachless::certify
