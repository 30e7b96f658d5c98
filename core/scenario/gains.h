#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "base/quantities.h"

/// A law's gains in the text form that messages have.
namespace tachless::scenario {

using Gains = std::map<std::string, Vector>;

/// Returns gains as text, "a=200;kp=400,300": every number to the last bit, and one number where
/// all are the same.
std::string gains_text(const Gains& gains);

/// Returns the gains of a text of `gains_text`, with `num_joints` entries where one number stands
/// for all. A matrix has the square of `num_joints`. Returns nothing for another text, and if a
/// number is not finite.
std::optional<Gains> read_gains(std::string_view text, int num_joints);

}  // namespace tachless::scenario
