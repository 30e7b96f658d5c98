#pragma once

#include <chrono>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "process/file_descriptor.h"

/// The CPUs that this process may use, which of them another run on this machine has, and how long
/// it takes to wake somebody there.
namespace tachless::process {

/// In ascending order; never empty.
std::vector<int> allowed_cpus();

/// A CPU that is this process's among all that ask so, until destruction or its end. Leaves nothing
/// behind: it is a lock on the CPU's entry in /sys.
class CpuClaim {
 public:
  /// Nothing when another process has it, or there is no such entry.
  static std::optional<CpuClaim> of(
      int cpu, const std::filesystem::path& entries = "/sys/devices/system/cpu");

  [[nodiscard]] int cpu() const { return cpu_; }

 private:
  CpuClaim(int cpu, FileDescriptor lock) : cpu_(cpu), lock_(std::move(lock)) {}

  int cpu_;
  FileDescriptor lock_;
};

/// From a thread on CPU `one` to a thread on CPU `other` and back, each woken by the other: the
/// median of many. Takes some milliseconds.
/// @throw std::system_error where threads cannot be bound to these CPUs
std::chrono::nanoseconds wake_up_round_trip(int one, int other);

}  // namespace tachless::process
