#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

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
  Feasibility feasibility;
  std::optional<lyapunov::StabilityCertificate> stability;  ///< nothing under an unstable loop
  std::optional<lyapunov::PaperConditions> paper;           ///< where it was asked for
  std::string no_stability;                                 ///< why there is no region
  std::optional<lyapunov::WeightedRegion> weighted;         ///< the region of the other laws
  /// Largest error of each joint that its range allows at the start [rad; m], half a turn where it
  /// has no limits: no region is shown beyond. Empty: not known.
  Eigen::VectorXd start_range;
  /// The answer whether every start converges; nothing: not known of this law, or not examined.
  std::optional<lyapunov::GlobalConvergence> global;
  std::optional<lyapunov::SampledRegion> nonlinear;  ///< where it was asked for
  std::string no_nonlinear;                          ///< why there is none; empty: not asked for
};

/// @param paper with the conditions that Loria and Ortega (1995) print
/// @param full with the region of the loop as it is sampled, and missed ticks in lock-step too
/// @param answers as of `analyse`
/// @throw base::Failure(bad_usage) when law, robot or reference cannot be made of it.
Certificate certify(const scenario::Scenario& scenario, bool paper,
                    const linear::OnProgress& tell = linear::no_progress, bool full = false,
                    const linear::LawAnswers& answers = {});

/// Returns what `lyapunov::certified_run` does; nothing under a sampled loop that `no_region`
/// names.
std::optional<lyapunov::CertifiedRun> certified_run(const scenario::Scenario& scenario);

/// Returns the reasons why a run must fail: an unstable loop, torque or speed beyond a limit.
std::vector<std::string> objections(const Certificate& certificate);

/// For people: five lines, and what the paper prints where it was asked for.
/// @param full in their place all numbers of the JSON, in its order
std::string page(const Certificate& certificate, const scenario::Scenario& scenario, bool full);
/// null stands for what is infinite or missing.
nlohmann::ordered_json to_json(const Certificate& certificate);
/// `start` of its group `region`, and of summary.json; `certified` is null where it is not decided.
nlohmann::ordered_json to_json(const lyapunov::CertifiedStart& start);
/// Its group `sampled`, which with less effort lacks the margins, and the line for people as
/// `text`.
nlohmann::ordered_json to_json(const Prediction& prediction);

}  // namespace tachless::certify
