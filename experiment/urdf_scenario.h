#pragma once

#include <string>

#include "robot/model.h"

namespace tachless::experiment {

/// A scenario for a bare URDF, as text, with gains that only a design makes useful: point to point,
/// a 20-bit encoder, one tick of delay.
/// @param urdf its path, as it is to stand in the file
std::string urdf_scenario(const robot::Model& model, const std::string& name,
                          const std::string& urdf, double period_s);

}  // namespace tachless::experiment
