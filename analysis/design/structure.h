#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "design/design.h"

/// Structures of gains, and the choice between their designs.
namespace tachless::design {

/// Dependence of the gains on joints and posture.
enum class Structure {
  diagonal,  ///< kp, kd and filter pole of each joint, constant (loria_ortega_rigid)
  matrix,    ///< one constant matrix for all postures (loria_ortega_matrix)
  scheduled  ///< M(q_ref) times four numbers (loria_ortega_scheduled)
};
constexpr std::array<std::string_view, 3> names(Structure /*type*/) {
  return {"diagonal", "matrix", "scheduled"};
}

/// Returns the name of the law whose gains have that structure.
std::string_view law_of(Structure structure);

/// Bandwidth of scheduled gains if the user gives none [Hz]: errors settle in about 0.1 s.
/// Resonances of gears and bandwidths of current loops, which a URDF does not state, are above this
/// frequency.
inline constexpr double default_bandwidth_hz = 10;
/// The default bandwidth is not made smaller than this for a far start [Hz].
inline constexpr double least_default_hz = 2;

/// Returns whether the arm comes back from a far start with the design's gains.
using Suits = std::function<bool(const Design&)>;
/// Returns the design within a bandwidth [Hz]. It may end early where the gains do not suit, as in
/// `Beside::suits`.
/// @throw base::Failure(check_said_no) if there are no gains
using DesignWithin = std::function<Design(double hz, const Suits& suits)>;

/// Returns the design within the default bandwidth. The bandwidth is made smaller, down to
/// `least_default_hz`, while the arm does not come back. If no smaller one helps, or one of them
/// has no gains, returns the design of the default bandwidth. A warning of the design says so.
/// @throw base::Failure(check_said_no) if the default bandwidth has no gains
Design within_default_bandwidth(const DesignWithin& designed, const Suits& returns);

/// Result of the search for gains of one structure.
struct Candidate {
  Structure structure = Structure::diagonal;
  scenario::Scenario scenario;   ///< scenario with the structure's law
  std::optional<Design> design;  ///< nothing: no gains were found
  std::string refusal;           ///< why there are none
};

/// Designs of the structures, and the chosen one.
struct Comparison {
  std::vector<Candidate> candidates;  ///< diagonal, then scheduled
  std::size_t chosen = 0;             ///< index of the candidate, which has a design
  std::string reason;                 ///< one sentence
};

/// Designs diagonal and scheduled gains, and chooses between them. Scheduled gains are the default.
/// They are at most as fast as `default_bandwidth_hz` unless the goal has a bandwidth. The default
/// is a fifth smaller, again and again, while the torque limits keep the arm from coming back from
/// a far start (`returns_from_beside`). A warning of the design says so. Diagonal
/// gains are chosen under three conditions. They settle at most a tenth later. They keep the margin
/// over the range of the joints. Friction stops no joint far from its goal.
/// @param scenario_with returns the scenario with the law of a structure
/// @throw base::Failure(check_said_no) if no structure has gains
Comparison compare(const std::function<scenario::Scenario(Structure)>& scenario_with,
                   const DesignGoal& goal, const linear::OnProgress& tell);

}  // namespace tachless::design
