#include "process/child.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <string_view>
#include <system_error>
#include <utility>

#include "diagnostics/failure.h"

namespace tachless::process {
namespace {

constexpr std::size_t longest_line = 4096;

[[noreturn]] void fail(const char* call) {
  throw std::system_error(errno, std::generic_category(), call);
}

void end_line(Child& child, const std::function<void(std::string)>& on_line) {
  std::string line = std::exchange(child.partial, {});
  if (!line.empty()) on_line(std::move(line));
}

/// What exec takes: pointers into `command`, and a null.
std::vector<char*> arguments(const std::vector<std::string>& command) {
  std::vector<char*> argv;
  argv.reserve(command.size() + 1);
  for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  return argv;
}

/// No CPU: nothing to do.
bool execute_on(const std::vector<int>& cpus) {
  if (cpus.empty()) return true;
  cpu_set_t set;
  CPU_ZERO(&set);
  for (const int cpu : cpus) CPU_SET(static_cast<std::size_t>(cpu), &set);
  return sched_setaffinity(0, sizeof set, &set) == 0;
}

}  // namespace

sigset_t blocked_signals() {
  sigset_t mask;
  sigprocmask(SIG_SETMASK, nullptr, &mask);
  return mask;
}

Child start(const std::vector<std::string>& command, const sigset_t& mask,
            const std::vector<int>& cpus, int input) {
  std::array<int, 2> output{};
  std::array<int, 2> refusal{};  // carries errno when exec fails; closed by exec when it works
  if (pipe2(output.data(), O_CLOEXEC) != 0) fail("pipe2");
  FileDescriptor output_read(output[0]);
  FileDescriptor output_write(output[1]);
  if (pipe2(refusal.data(), O_CLOEXEC) != 0) fail("pipe2");
  FileDescriptor refusal_read(refusal[0]);
  FileDescriptor refusal_write(refusal[1]);
  if (fcntl(output_read.get(), F_SETFL, O_NONBLOCK) != 0) fail("fcntl");

  const std::vector<char*> argv = arguments(command);
  const pid_t parent = getpid();
  const pid_t pid = fork();
  if (pid < 0) fail("fork");
  if (pid == 0) {
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (input < 0) input = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
    if (getppid() == parent && input >= 0 && dup2(input, STDIN_FILENO) >= 0 &&
        dup2(output_write.get(), STDOUT_FILENO) >= 0 &&
        dup2(output_write.get(), STDERR_FILENO) >= 0 &&
        sigprocmask(SIG_SETMASK, &mask, nullptr) == 0 && execute_on(cpus)) {
      execvp(argv[0], argv.data());
    }
    const int error = errno;
    [[maybe_unused]] const ssize_t written = ::write(refusal_write.get(), &error, sizeof error);
    _exit(127);
  }
  refusal_write = FileDescriptor();
  int error = 0;
  ssize_t got;
  do {
    got = ::read(refusal_read.get(), &error, sizeof error);
  } while (got < 0 && errno == EINTR);
  if (got == sizeof error) {
    waitpid(pid, nullptr, 0);
    throw diagnostics::bad_usage(
        "cannot start {}: {}; install it, or, if it is one of tachless, build the whole project",
        command.front(), std::strerror(error));
  }
  Child child;
  child.pid = pid;
  child.running = true;
  child.output = std::move(output_read);
  return child;
}

void read_lines(Child& child, const std::function<void(std::string)>& on_line) {
  std::array<char, 4096> buffer;
  ssize_t got = -1;
  while (child.output.get() >= 0 &&
         (got = ::read(child.output.get(), buffer.data(), buffer.size())) > 0) {
    for (const char c : std::string_view(buffer.data(), static_cast<std::size_t>(got))) {
      if (c != '\n') child.partial += c;
      if (c == '\n' || child.partial.size() >= longest_line) end_line(child, on_line);
    }
  }
  if (got == 0) child.output = FileDescriptor();
  if (child.output.get() < 0 || !child.running) end_line(child, on_line);
}

Finished run(const std::vector<std::string>& command) {
  Child child = start(command);
  Finished result;
  const auto keep = [&](std::string line) { result.lines.push_back(std::move(line)); };
  while (child.output.get() >= 0) {
    pollfd fd{child.output.get(), POLLIN, 0};
    poll(&fd, 1, -1);
    read_lines(child, keep);
  }
  int status = 0;
  while (waitpid(child.pid, &status, 0) < 0 && errno == EINTR) {
  }
  if (WIFSIGNALED(status)) result.signal = WTERMSIG(status);
  if (WIFEXITED(status)) result.exit_code = WEXITSTATUS(status);
  return result;
}

std::optional<std::filesystem::path> find_program(const std::string& name) {
  const char* variable = std::getenv("PATH");
  std::istringstream path(variable == nullptr ? "" : variable);
  for (std::string folder; std::getline(path, folder, ':');) {
    const std::filesystem::path candidate = std::filesystem::path(folder) / name;
    if (access(candidate.c_str(), X_OK) == 0) return candidate;
  }
  return std::nullopt;
}

void become(const std::vector<std::string>& command, const std::string& remedy) {
  const std::vector<char*> argv = arguments(command);
  execv(argv[0], argv.data());
  throw diagnostics::bad_usage("cannot start {}: {}; {}", command.front(), std::strerror(errno),
                               remedy);
}

bool works_in_a_copy(bool (*attempt)()) {
  const pid_t pid = fork();
  if (pid == 0) _exit(attempt() ? 0 : 1);
  int status = 1;
  if (pid > 0) waitpid(pid, &status, 0);
  return pid > 0 && status == 0;
}

}  // namespace tachless::process
