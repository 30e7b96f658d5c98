#pragma once

#include "experiment/scenario.h"
#include "node/link.h"

namespace tachless::reference {

/// The reference process: answers TICK(k) with the reference of k + 1, one tick ahead, until the
/// plant has finished.
/// @throw diagnostics::Failure bad_usage (scenario), protocol_violated (two plants),
/// protective_stop (a reference that is not finite), and what the link throws.
void run_node(const experiment::Scenario& scenario, node::Link& link);

}  // namespace tachless::reference
