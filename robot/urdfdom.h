#pragma once

#include <urdf_model/model.h>
#include <urdf_world/types.h>

#include <string>

namespace tachless::robot {

/// The description that urdfdom makes of a URDF's text; nothing is printed.
/// @throw std::invalid_argument, one line with `source`, for whatever urdfdom objects to
urdf::ModelInterfaceSharedPtr parse_with_urdfdom(const std::string& text,
                                                 const std::string& source);

}  // namespace tachless::robot
