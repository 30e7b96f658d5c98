#pragma once

#include "logger/run_log.h"
#include "study/tracking.h"

namespace tachless::report {

/// Adds one tick's record to `tracking`. Link angles are the plant's true ones where the log has
/// them, the measured ones elsewhere; a tick that lacks angle, reference or torque is left out.
void add(study::Tracking& tracking, const logger::TickRecord& record, double period_s);

/// All that a log tells of tracking. Reads `log` to its end, so that its summary is final.
study::Tracking track(logger::RunLog& log);

}  // namespace tachless::report
