#pragma once

#include <string>
#include <vector>

#include "robot/mjcf.h"

namespace tachless::robot {

/// Returns whether a MuJoCo model has something besides its robot. This is a shape of the world, or
/// a body of the world that carries neither hinge nor slide joint.
/// @param source name of the file, for messages
/// @throw std::invalid_argument, one line, for a text that is no MJCF
bool has_surroundings(const std::string& text, const std::string& source,
                      const IncludedText& included);

/// Returns the files that an MJCF includes itself, in the order of its elements; none for a text
/// that is no XML.
std::vector<std::string> included_files(const std::string& text);

}  // namespace tachless::robot
