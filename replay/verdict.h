#pragma once

#include <string>

#include "replay/replay.h"
#include "robot/joint_labels.h"

/// What a replay found, in words. Decides nothing and prints nothing.
namespace tachless::replay {

/// What hinders a full verdict; empty when nothing does.
std::string hindrance(const Replay& replay, const logger::RunLog& log);

/// Why the recorded commands are not all verified as the same; empty when they are.
std::string problem_text(const Replay& replay, const logger::RunLog& log,
                         const robot::JointLabels& joints);

/// What was verified, after a replay that took `wall_s` and has no problem.
std::string verified_text(const Replay& replay, const logger::RunLog& log, double wall_s);

/// Events of the log that could not be read; empty when there are none.
std::string damage_text(const logger::RunLog& log);

}  // namespace tachless::replay
