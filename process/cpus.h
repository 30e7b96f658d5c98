#pragma once

#include <chrono>
#include <filesystem>
#include <optional>
#include <vector>

#include "process/file_descriptor.h"

/// The CPUs that this process may use, which of them another run on this machine has, and how long
/// it takes to wake somebody there.
namespace tachless::process {

/// In ascending order; never empty.
std::vector<int> allowed_cpus();

/// From now on this thread executes on these CPUs alone; on what it did before when there are none.
/// @return false, and errno, when the system refuses
bool execute_on(const std::vector<int>& cpus);

/// Makes a CPU this process's among all that ask so, until the end of the process or of what is
/// returned: a lock on the CPU's entry in /sys, which leaves nothing behind. Nothing when another
/// process has it, or there is no such entry.
std::optional<FileDescriptor> claim_cpu(
    int cpu, const std::filesystem::path& entries = "/sys/devices/system/cpu");

/// From a thread on CPU `one` to a thread on CPU `other` and back, each woken by the other: the
/// median of many. Takes some milliseconds.
/// @throw std::system_error where threads cannot be bound to these CPUs
std::chrono::nanoseconds wake_up_round_trip(int one, int other);

}  // namespace tachless::process
