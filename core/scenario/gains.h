#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "base/quantities.h"

/// A law's gains as they travel in messages.
namespace tachless::scenario {

using Gains = std::map<std::string, Vector>;

/// "a=200;kp=400,300": every number to the last bit, a number alone where all are the same.
std::string gains_text(const Gains& gains);

/// The reverse, with `num_joints` entries where one number stands for all; a matrix has its square.
/// Nothing when it is not such a text, or a number is not finite.
std::optional<Gains> read_gains(std::string_view text, int num_joints);

}  // namespace tachless::scenario
