#include "process/cpus.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <sched.h>
#include <sys/eventfd.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <exception>
#include <system_error>
#include <thread>

namespace tachless::process {
namespace {

constexpr int num_rounds = 101;

void stay_on(int cpu) {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(cpu), &set);
  if (sched_setaffinity(0, sizeof set, &set) != 0) {
    throw std::system_error(errno, std::generic_category(), "sched_setaffinity");
  }
}

FileDescriptor event() {
  FileDescriptor fd(::eventfd(0, EFD_CLOEXEC));
  if (fd.get() < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
  return fd;
}

void wake(const FileDescriptor& who) {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(who.get(), &one, sizeof one);
}

void wait_for(const FileDescriptor& event) {
  std::uint64_t count = 0;
  while (::read(event.get(), &count, sizeof count) < 0 && errno == EINTR) {
  }
}

}  // namespace

std::vector<int> allowed_cpus() {
  cpu_set_t set;
  CPU_ZERO(&set);
  std::vector<int> cpus;
  if (sched_getaffinity(0, sizeof set, &set) == 0) {
    for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu) {
      if (CPU_ISSET(static_cast<std::size_t>(cpu), &set)) cpus.push_back(cpu);
    }
  }
  if (cpus.empty()) cpus.push_back(std::max(sched_getcpu(), 0));
  return cpus;
}

std::optional<CpuClaim> CpuClaim::of(int cpu, const std::filesystem::path& entries) {
  const std::filesystem::path entry = entries / fmt::format("cpu{}", cpu);
  FileDescriptor lock(::open(entry.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (lock.get() < 0 || ::flock(lock.get(), LOCK_EX | LOCK_NB) != 0) return std::nullopt;
  return CpuClaim(cpu, std::move(lock));
}

std::chrono::nanoseconds wake_up_round_trip(int one, int other) {
  using Clock = std::chrono::steady_clock;
  const FileDescriptor there = event();
  const FileDescriptor back = event();
  std::array<std::chrono::nanoseconds, num_rounds> rounds{};
  std::array<std::exception_ptr, 2> problems;
  const auto on = [&](int cpu, std::exception_ptr& problem, auto&& rounds_of) {
    return std::thread([=, &problem] {
      try {
        stay_on(cpu);
      } catch (...) {
        problem = std::current_exception();  // the rounds go on: the other thread waits for them
      }
      rounds_of();
    });
  };
  std::thread answering = on(other, problems[1], [&] {
    for (int i = 0; i < num_rounds; ++i) {
      wait_for(there);
      wake(back);
    }
  });
  std::thread asking = on(one, problems[0], [&] {
    for (std::chrono::nanoseconds& round : rounds) {
      const Clock::time_point begin = Clock::now();
      wake(there);
      wait_for(back);
      round = Clock::now() - begin;
    }
  });
  asking.join();
  answering.join();
  for (const std::exception_ptr& problem : problems) {
    if (problem) std::rethrow_exception(problem);
  }
  std::ranges::nth_element(rounds, rounds.begin() + num_rounds / 2);
  return rounds[num_rounds / 2];
}

}  // namespace tachless::process
