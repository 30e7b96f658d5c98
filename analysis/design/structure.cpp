#include "design/structure.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>
#include <utility>

#include "base/failure.h"
#include "base/schema.h"
#include "design/far_start.h"

namespace tachless::design {

std::string_view law_of(Structure structure) {
  switch (structure) {
    case Structure::diagonal:
      return "loria_ortega_rigid";
    case Structure::matrix:
      return "loria_ortega_matrix";
    case Structure::scheduled:
      return "loria_ortega_scheduled";
  }
  return "";
}

namespace {

/// Returns the index of the better candidate, and the reason.
std::pair<std::size_t, std::string> choice(const std::vector<Candidate>& candidates,
                                           const DesignGoal& goal) {
  constexpr std::size_t diagonal = 0, scheduled = 1;
  if (!candidates[scheduled].design) return {diagonal, "no scheduled gains keep the margin"};
  if (!candidates[diagonal].design) return {scheduled, "no diagonal gains keep the margin"};
  const Design &one = *candidates[diagonal].design, &other = *candidates[scheduled].design;
  if (one.objections.empty() != other.objections.empty()) {
    return {one.objections.empty() ? diagonal : scheduled,
            "with the others, friction stops a joint far beside its goal"};
  }
  const double slower = one.loop.modes.settling_s / other.loop.modes.settling_s;
  if (slower <= 1.1 && one.modulus_in_range >= range_share * goal.modulus) {
    return {diagonal, "diagonal gains are as good, and simpler"};
  }
  if (slower <= 1.1) {
    return {scheduled, "scheduled gains have the same margin at every posture"};
  }
  return {scheduled, fmt::format("scheduled gains settle {:.2g} times as fast", slower)};
}

}  // namespace

Design within_default_bandwidth(const DesignWithin& designed, const Suits& returns) {
  constexpr double smaller = 0.8;
  bool refused = false;
  const Suits suits = [&](const Design& gains) {
    refused = !returns(gains);
    return !refused;
  };
  Design usual = designed(default_bandwidth_hz, suits);
  const bool is_complete = !refused;
  if (is_complete && returns(usual)) return usual;
  double least_hz = default_bandwidth_hz;
  for (double hz = smaller * default_bandwidth_hz; hz >= least_default_hz; hz *= smaller) {
    refused = false;
    Design slower;
    try {
      slower = designed(hz, suits);
    } catch (const base::Failure& failure) {
      if (failure.code() != base::ExitCode::check_said_no) throw;
      break;  // slower gains lack what these lack; the usual ones are kept
    }
    least_hz = hz;
    if (refused || !returns(slower)) continue;
    slower.warnings.push_back(fmt::format(
        "the bandwidth is {:.2g} Hz in place of {:g}: with more, the torque limits keep the arm "
        "from coming back from {:g} rad beside its motion; --bandwidth {:g} takes the faster gains",
        hz, default_bandwidth_hz, far_start_error, default_bandwidth_hz));
    return slower;
  }
  if (!is_complete) usual = designed(default_bandwidth_hz, {});
  usual.warnings.push_back(fmt::format(
      "the torque limits keep the arm from coming back from {:g} rad beside its motion, "
      "with {} {:.2g} Hz: start it near its motion",
      far_start_error,
      least_hz < default_bandwidth_hz
          ? fmt::format("any bandwidth from {:g} down to", default_bandwidth_hz)
          : "the bandwidth of",
      least_hz));
  return usual;
}

Comparison compare(const std::function<scenario::Scenario(Structure)>& scenario_with,
                   const DesignGoal& goal, const linear::OnProgress& tell) {
  Comparison comparison;
  for (const Structure each : {Structure::diagonal, Structure::scheduled}) {
    comparison.candidates.push_back({each, scenario_with(each), {}, {}});
  }
  // The search for scheduled gains has four variables and comes first. Its gains say how much the
  // longer one for diagonal gains is worth.
  Beside beside{.another_follows = true};
  for (auto at = comparison.candidates.rbegin(); at != comparison.candidates.rend(); ++at) {
    Candidate& candidate = *at;
    const std::string name(base::name_of(candidate.structure));
    const linear::OnProgress tell_of_it = [&](std::string_view what) {
      tell(fmt::format("{} gains: {}", name, what));
    };
    const bool by_default = candidate.structure == Structure::scheduled && !goal.bandwidth_hz;
    try {
      const auto designed = [&](std::optional<double> hz, const Suits& suits) {
        DesignGoal within = goal;
        within.bandwidth_hz = hz;
        Beside here = beside;
        here.suits = suits;
        return design(candidate.scenario, within, tell_of_it, {}, here);
      };
      const Suits returns = [&](const Design& found) {
        return returns_from_beside(candidate.scenario, found);
      };
      candidate.design = by_default ? within_default_bandwidth(designed, returns)
                                    : designed(goal.bandwidth_hz, {});
      beside.settling_s = candidate.design->loop.modes.settling_s;
    } catch (const base::Failure& failure) {
      if (failure.code() != base::ExitCode::check_said_no) throw;
      candidate.refusal = failure.what();
    }
    beside.another_follows = false;
  }
  if (std::ranges::none_of(comparison.candidates,
                           [](const Candidate& each) { return each.design.has_value(); })) {
    throw base::Failure(base::ExitCode::check_said_no, "{}", comparison.candidates.front().refusal);
  }
  std::tie(comparison.chosen, comparison.reason) = choice(comparison.candidates, goal);
  return comparison;
}

}  // namespace tachless::design
