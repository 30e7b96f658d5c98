#include "process/cpus.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <sched.h>
#include <semaphore.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <future>
#include <system_error>

namespace tachless::process {
namespace {

constexpr std::size_t num_rounds = 101;

void wait(sem_t* event) {
  while (sem_wait(event) != 0 && errno == EINTR) {
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

bool execute_on(const std::vector<int>& cpus) {
  if (cpus.empty()) return true;
  cpu_set_t set;
  CPU_ZERO(&set);
  for (const int cpu : cpus) CPU_SET(static_cast<std::size_t>(cpu), &set);
  return sched_setaffinity(0, sizeof set, &set) == 0;
}

std::optional<FileDescriptor> claim_cpu(int cpu, const std::filesystem::path& entries) {
  const std::filesystem::path entry = entries / fmt::format("cpu{}", cpu);
  FileDescriptor lock(::open(entry.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (lock.get() < 0 || ::flock(lock.get(), LOCK_EX | LOCK_NB) != 0) return std::nullopt;
  return lock;
}

std::chrono::nanoseconds wake_up_round_trip(int one, int other) {
  using Clock = std::chrono::steady_clock;
  sem_t there, back;
  sem_init(&there, 0, 0);
  sem_init(&back, 0, 0);
  std::array<std::chrono::nanoseconds, num_rounds> rounds{};
  // Where it is not bound the rounds go on all the same: the other thread waits for them.
  const auto on = [](int cpu, auto round) {
    return std::async(std::launch::async, [=] {
      const int problem = execute_on({cpu}) ? 0 : errno;
      for (std::size_t i = 0; i < num_rounds; ++i) round(i);
      if (problem != 0) {
        throw std::system_error(problem, std::generic_category(), "sched_setaffinity");
      }
    });
  };
  auto answering = on(other, [&](std::size_t /*i*/) {
    wait(&there);
    sem_post(&back);
  });
  auto asking = on(one, [&](std::size_t i) {
    const Clock::time_point begin = Clock::now();
    sem_post(&there);
    wait(&back);
    rounds[i] = Clock::now() - begin;
  });
  asking.get();
  answering.get();
  std::ranges::nth_element(rounds, rounds.begin() + num_rounds / 2);
  return rounds[num_rounds / 2];
}

}  // namespace tachless::process
