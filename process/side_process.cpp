#include "process/side_process.h"

#include <poll.h>
#include <sys/wait.h>

#include <fmt/format.h>

#include <csignal>
#include <cstring>
#include <utility>

#include "diagnostics/failure.h"

namespace tachless::process {
namespace {

using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto patience = 1s;  // from SIGTERM to SIGKILL

/// Waits for output of the child, at most 50 ms.
void doze(const Child& child) {
  pollfd fd{child.output.get(), POLLIN, 0};
  poll(&fd, 1, 50);
}

}  // namespace

SideProcess::SideProcess(std::string name, const std::vector<std::string>& command,
                         std::string_view ready, std::chrono::milliseconds limit, OnLine on_line)
    : name_(std::move(name)), child_(start(command)) {
  bool is_ready = false;
  on_line_ = [&](std::string_view line) {
    if (is_ready) on_line(line);
    is_ready = is_ready || line == ready;
  };
  const Clock::time_point deadline = Clock::now() + limit;
  while (attend(), !is_ready) {
    if (child_.running && Clock::now() < deadline) {
      doze(child_);
      continue;
    }
    const std::string why = child_.running
                                ? fmt::format("{} was not ready within {} s", name_, limit / 1s)
                            : last_line_.empty() ? trouble_
                                                 : last_line_;
    end_group();
    if (child_.running) waitpid(child_.pid, nullptr, 0);
    throw diagnostics::bad_usage(why);
  }
  on_line_ = std::move(on_line);
}

SideProcess::~SideProcess() { stop(); }

void SideProcess::attend() {
  const auto pass_on = [&](std::string line) {
    on_line_(line);
    last_line_ = std::move(line);
  };
  read_lines(child_, pass_on);
  int status = 0;
  if (!child_.running || waitpid(child_.pid, &status, WNOHANG) != child_.pid) return;
  child_.running = false;
  end_group();
  read_lines(child_, pass_on);
  if (WIFSIGNALED(status)) {
    trouble_ = fmt::format("{} was killed by signal {} ({})", name_, WTERMSIG(status),
                           strsignal(WTERMSIG(status)));
  } else if (WEXITSTATUS(status) != 0) {
    trouble_ = fmt::format("{} ended with exit code {}", name_, WEXITSTATUS(status));
  }
}

void SideProcess::signal(int number) const {
  if (child_.running) kill(child_.pid, number);
}

void SideProcess::stop() {
  signal(SIGTERM);
  for (const auto deadline = Clock::now() + patience; child_.running && Clock::now() < deadline;) {
    doze(child_);
    attend();
  }
  if (!child_.running) return;
  end_group();
  waitpid(child_.pid, nullptr, 0);
  child_.running = false;
}

// What it has started itself is in its process group, and may outlive it.
void SideProcess::end_group() const { kill(-child_.pid, SIGKILL); }

}  // namespace tachless::process
