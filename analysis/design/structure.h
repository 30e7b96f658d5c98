#pragma once

#include <array>
#include <cstddef>
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

/// Bandwidth of scheduled gains if the user gives none [Hz]: errors settle in about 0.1 s. Springs
/// of gears and current loops, which a URDF does not state, lie above.
inline constexpr double default_bandwidth_hz = 10;

/// Result of the search for gains of one structure.
struct Candidate {
  Structure structure = Structure::diagonal;
  std::optional<Design> design;  ///< nothing: no gains were found
  std::string refusal;           ///< why there are none
};

struct Choice {
  std::size_t chosen = 0;  ///< index of the candidate
  std::string reason;      ///< one sentence
};

/// Chooses between the diagonal and the scheduled candidate. Scheduled gains are the default. The
/// diagonal ones are chosen if the user asks for the stiffness of single joints, or if they are as
/// good: they settle at most a tenth later and keep the margin over the range of the joints.
/// @param of_joints the user asks for the stiffness of single joints
/// @throw base::Failure(check_said_no) if no candidate has gains
Choice choose(const std::vector<Candidate>& candidates, const DesignGoal& goal, bool of_joints);

}  // namespace tachless::design
