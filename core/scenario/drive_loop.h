#pragma once

#include <optional>
#include <string_view>

#include "plant/spec.h"
#include "scenario/scenario.h"

namespace tachless::scenario {

/// Returns the loop inside the drives, the map `plant.drive.loop`; nothing without one. The
/// scenario holds it as text.
/// @throw Failure(bad_usage), one line: where, key, value, what is allowed.
std::optional<plant::DriveLoopSpec> drive_loop(const Scenario& scenario);

/// Returns the width of one count of each drive's own encoder [rad; m if prismatic]; 0: ideal.
/// @throw Failure(bad_usage) as `encoder_count`
Vector drive_count(const Scenario& scenario, const plant::DriveLoopSpec& loop,
                   const robot::Model& model);

/// Refuses a scenario with `plant.drive.loop`.
/// @param why one clause: "identify needs the whole torque"
/// @throw Failure(bad_usage)
void require_no_drive_loop(const Scenario& scenario, std::string_view why);

}  // namespace tachless::scenario
