#include "design/structure.h"

#include <fmt/format.h>

#include <algorithm>

#include "base/failure.h"
#include "base/schema.h"

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

Choice choose(const std::vector<Candidate>& candidates, const DesignGoal& goal, bool of_joints) {
  const auto find = [&](Structure structure) {
    return static_cast<std::size_t>(std::ranges::find_if(candidates,
                                                         [&](const Candidate& each) {
                                                           return each.structure == structure &&
                                                                  each.design;
                                                         }) -
                                    candidates.begin());
  };
  const std::size_t diagonal = find(Structure::diagonal), scheduled = find(Structure::scheduled);
  const std::size_t none = candidates.size();
  if (diagonal == none && scheduled == none) {
    throw base::Failure(base::ExitCode::check_said_no, "{}", candidates.front().refusal);
  }
  if (scheduled == none) return {diagonal, "no scheduled gains keep the margin"};
  if (diagonal == none) return {scheduled, "no diagonal gains keep the margin"};
  if (of_joints) return {diagonal, "the stiffness of single joints is asked for"};
  const Design &one = *candidates[diagonal].design, &other = *candidates[scheduled].design;
  const double slower = one.loop.modes.settling_s / other.loop.modes.settling_s;
  if (slower <= 1.1 && one.modulus_in_range >= range_share * goal.modulus) {
    return {diagonal, "diagonal gains are as good, and simpler"};
  }
  if (slower <= 1) {
    return {scheduled, "scheduled gains have the same margin at every posture"};
  }
  return {scheduled, fmt::format("scheduled gains settle {:.2g} times as fast", slower)};
}

}  // namespace tachless::design
