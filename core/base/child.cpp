#include "base/child.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <system_error>
#include <utility>

#include "base/failure.h"
#include "base/this_process.h"

namespace tachless::base {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t longest_line = 4096;

[[noreturn]] void fail(const char* call) {
  throw std::system_error(errno, std::generic_category(), call);
}

void end_line(Child& child, const std::function<void(std::string)>& on_line) {
  std::string line = std::exchange(child.partial, {});
  if (!line.empty()) on_line(std::move(line));
}

/// Returns the argument of exec: pointers into `command`, and a null.
std::vector<char*> arguments(const std::vector<std::string>& command) {
  std::vector<char*> argv;
  argv.reserve(command.size() + 1);
  for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  return argv;
}

/// Waits for output of the child. @param limit_ms -1: none
void await_output(const Child& child, int limit_ms) {
  pollfd fd{child.output.get(), POLLIN, 0};
  poll(&fd, 1, limit_ms);
}

}  // namespace

std::string text(const End& end) {
  if (end.signal != 0) {
    return fmt::format("was killed by signal {} ({})", end.signal, strsignal(end.signal));
  }
  return end.exit_code == 0 ? "ended" : fmt::format("ended with exit code {}", end.exit_code);
}

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

  std::signal(SIGCHLD, SIG_DFL);  // ignored, as it may be inherited, it would leave no end to take
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
    throw base::bad_usage(
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

std::optional<End> take_end(Child& child, bool wait) {
  if (!child.running) return std::nullopt;
  int status = 0;
  pid_t ended = 0;
  do {
    ended = waitpid(child.pid, &status, wait ? 0 : WNOHANG);
  } while (ended < 0 && errno == EINTR);
  if (ended != child.pid) return std::nullopt;
  child.running = false;
  return WIFSIGNALED(status) ? End{0, WTERMSIG(status)} : End{WEXITSTATUS(status), 0};
}

End end_within(Child& child, std::chrono::milliseconds patience, const OnLine& on_line) {
  // Not reaped before its group is killed: until then no other process can have its number.
  const auto has_ended = [&] {
    siginfo_t info{};
    return waitid(P_PID, static_cast<id_t>(child.pid), &info, WEXITED | WNOHANG | WNOWAIT) != 0 ||
           info.si_pid == child.pid;
  };
  for (const auto deadline = Clock::now() + patience; !has_ended() && Clock::now() < deadline;) {
    await_output(child, 20);
    read_lines(child, on_line);
  }
  kill(-child.pid, SIGKILL);
  const End end = take_end(child, true).value_or(End());
  read_lines(child, on_line);
  return end;
}

Finished run(const std::vector<std::string>& command) {
  Child child = start(command);
  Finished result;
  while (child.output.get() >= 0) {
    await_output(child, -1);
    read_lines(child, [&](std::string line) { result.lines.push_back(std::move(line)); });
  }
  static_cast<End&>(result) = take_end(child, true).value_or(End());
  return result;
}

std::optional<std::filesystem::path> find_program(const std::string& name) {
  const char* variable = std::getenv("PATH");
  std::istringstream path(variable == nullptr ? "" : variable);
  for (std::string folder; std::getline(path, folder, ':');) {
    const std::filesystem::path candidate = std::filesystem::path(folder) / name;
    if (access(candidate.c_str(), X_OK) == 0 && !std::filesystem::is_directory(candidate)) {
      return candidate;
    }
  }
  return std::nullopt;
}

void become(const std::vector<std::string>& command, const std::string& remedy) {
  const std::vector<char*> argv = arguments(command);
  execv(argv[0], argv.data());
  throw base::bad_usage("cannot start {}: {}; {}", command.front(), std::strerror(errno), remedy);
}

bool works_in_a_copy(bool (*attempt)()) {
  std::signal(SIGCHLD, SIG_DFL);  // as in `start`
  const pid_t pid = fork();
  if (pid == 0) _exit(attempt() ? 0 : 1);
  int status = 1;
  if (pid > 0) waitpid(pid, &status, 0);
  return pid > 0 && status == 0;
}

}  // namespace tachless::base
