#include "launch/placement.h"

#include <fmt/core.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <optional>
#include <sstream>
#include <system_error>
#include <utility>

#include "diagnostics/failure.h"
#include "process/cpus.h"

namespace tachless::launch {
namespace {

using loop::Role;
using std::chrono::nanoseconds;

constexpr const char* asked_for = "asked for";
constexpr std::array loop_roles = {Role::plant, Role::controller, Role::reference};
// What goes on beside the way from the measurement to the command where processes have a CPU each:
// the reference's step, the controller's state.
constexpr nanoseconds in_parallel = std::chrono::microseconds(10);

[[noreturn]] void refuse(const std::string& wanted, const std::string& why) {
  throw diagnostics::bad_usage("--placement {}: {}", wanted, why);
}

void put(Placement& placement, Role role, std::vector<int> cpus) {
  placement.cpus[static_cast<std::size_t>(role)] = std::move(cpus);
}

/// Claims the last that no other run has: the first has the most of the kernel's own work.
std::optional<int> claim_one(const std::vector<int>& cpus, Placement& placement) {
  for (auto cpu = cpus.rbegin(); cpu != cpus.rend(); ++cpu) {
    auto claim = process::claim_cpu(*cpu);
    if (!claim) continue;
    placement.claims.push_back(std::move(*claim));
    return *cpu;
  }
  return std::nullopt;
}

Placement spread(std::string why) {
  Placement placement;
  placement.words = "spread over CPUs";
  placement.reason = std::move(why);
  return placement;
}

Placement together(std::vector<int> cpus, const std::string& why) {
  Placement placement;
  const std::optional<int> own = claim_one(cpus, placement);
  const int cpu = own.value_or(cpus[static_cast<std::size_t>(getpid()) % cpus.size()]);
  for (const Role role : loop_roles) put(placement, role, {cpu});
  if (cpus.size() > 1) std::erase(cpus, cpu);
  put(placement, Role::logger, cpus);
  placement.words =
      fmt::format("together on CPU {}{}", cpu, own ? "" : ", which another run has, too");
  placement.reason = why;
  return placement;
}

Placement spin(std::vector<int> cpus) {
  Placement placement;
  placement.spin = true;
  const std::string needs = "each of three processes needs a CPU for itself, and the rest one";
  if (cpus.size() <= loop_roles.size()) {
    refuse("spin", fmt::format("{}; this one may use {}; type: --placement together", needs,
                               fmt::join(cpus, ", ")));
  }
  std::vector<int> own;
  for (const Role role : loop_roles) {
    const std::optional<int> cpu = claim_one(cpus, placement);
    if (!cpu) refuse("spin", needs + "; other runs have them; type: --placement together");
    put(placement, role, {*cpu});
    std::erase(cpus, *cpu);
    own.push_back(*cpu);
  }
  put(placement, Role::logger, cpus);
  placement.words = fmt::format("awake on CPUs {}, {} and {}", own[0], own[1], own[2]);
  placement.reason = asked_for;
  return placement;
}

Placement automatic(const std::vector<int>& cpus, experiment::Mode mode) {
  if (mode == experiment::Mode::realtime) return spread("realtime");
  if (cpus.size() == 1) return spread("there is one CPU");
  try {
    const nanoseconds here = process::wake_up_round_trip(cpus.back(), cpus.back());
    const nanoseconds across = process::wake_up_round_trip(cpus.front(), cpus.back());
    const std::string measured =
        fmt::format("to wake somebody and be woken takes {:.1f} µs on one CPU, {:.1f} µs on two",
                    here.count() * 1e-3, across.count() * 1e-3);
    return across > here + in_parallel ? together(cpus, measured) : spread(measured);
  } catch (const std::system_error&) {
    return spread("processes cannot be bound to CPUs here");
  }
}

Placement listed(const std::string& wanted, const std::vector<int>& allowed) {
  std::vector<int> cpus;
  std::istringstream list(wanted + ",");  // so that an empty number at the end is one
  for (std::string word; std::getline(list, word, ',');) {
    int cpu = -1;
    const char* const end = word.data() + word.size();
    const auto read = std::from_chars(word.data(), end, cpu);
    if (read.ec != std::errc() || read.ptr != end) {
      refuse(wanted, "allowed: auto, spread, together, spin, or numbers of CPUs");
    }
    if (std::ranges::find(allowed, cpu) == allowed.end()) {
      refuse(wanted, fmt::format("CPU {} is none that this process may use; allowed: {}", cpu,
                                 fmt::join(allowed, ", ")));
    }
    cpus.push_back(cpu);
  }
  if (cpus.size() != 1 && cpus.size() != 2 && cpus.size() != 4) {
    refuse(wanted,
           "allowed: one CPU for all, two (plant, controller and reference; logger) or four "
           "(plant, controller, reference, logger)");
  }
  Placement placement;
  for (std::size_t i = 0; i < loop_roles.size(); ++i) {
    put(placement, loop_roles[i], {cpus[cpus.size() == 4 ? i : 0]});
  }
  put(placement, Role::logger, {cpus.back()});
  placement.words = "on CPUs " + wanted;
  placement.reason = asked_for;
  return placement;
}

}  // namespace

Placement choose_placement(const std::string& wanted, experiment::Mode mode) {
  const std::vector<int> cpus = process::allowed_cpus();
  if (wanted == "auto") return automatic(cpus, mode);
  if (wanted == "spread") return spread(asked_for);
  if (wanted == "together") return together(cpus, asked_for);
  if (wanted == "spin") return spin(cpus);
  return listed(wanted, cpus);
}

}  // namespace tachless::launch
