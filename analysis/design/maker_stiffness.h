#pragma once

#include <optional>
#include <string>

#include "robot/model.h"

namespace tachless::design {

/// Joint stiffness that an arm's maker publishes for its own controller.
struct MakerStiffness {
  std::string arm;     ///< "Franka Panda"
  std::string source;  ///< where the numbers are published
  Vector N_m_per_rad;  ///< stiffness of each joint of the model; 0 for a joint of a hand
};

/// Returns the stiffness that the maker of this arm publishes, or nothing. The names of the first
/// joints identify the arm. A prefix and a suffix of the names do not matter. Franka, KUKA (LBR
/// iiwa) and Universal Robots publish numbers. UFACTORY and Kinova do not.
std::optional<MakerStiffness> maker_stiffness(const robot::Model& model);

}  // namespace tachless::design
