#pragma once

#include <vector>

namespace tachless::process {

/// The CPUs that this process may use, in ascending order; never empty.
std::vector<int> allowed_cpus();

/// From now on this thread executes on these CPUs alone; without change when there are none.
/// @return false, and errno, when the system refuses
bool execute_on(const std::vector<int>& cpus);

}  // namespace tachless::process
