#include "process/child.h"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
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

}  // namespace

Child start(const std::vector<std::string>& command, const sigset_t& mask) {
  std::array<int, 2> output{};
  std::array<int, 2> refusal{};  // carries errno when exec fails; closed by exec when it works
  if (pipe2(output.data(), O_CLOEXEC) != 0) fail("pipe2");
  process::FileDescriptor output_read(output[0]);
  process::FileDescriptor output_write(output[1]);
  if (pipe2(refusal.data(), O_CLOEXEC) != 0) fail("pipe2");
  process::FileDescriptor refusal_read(refusal[0]);
  process::FileDescriptor refusal_write(refusal[1]);
  if (fcntl(output_read.get(), F_SETFL, O_NONBLOCK) != 0) fail("fcntl");

  std::vector<char*> argv;
  argv.reserve(command.size() + 1);
  for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);

  const pid_t parent = getpid();
  const pid_t pid = fork();
  if (pid < 0) fail("fork");
  if (pid == 0) {
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    const int null = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
    if (getppid() == parent && null >= 0 && dup2(null, STDIN_FILENO) >= 0 &&
        dup2(output_write.get(), STDOUT_FILENO) >= 0 &&
        dup2(output_write.get(), STDERR_FILENO) >= 0 &&
        sigprocmask(SIG_SETMASK, &mask, nullptr) == 0) {
      execv(argv[0], argv.data());
    }
    const int error = errno;
    [[maybe_unused]] const ssize_t written = ::write(refusal_write.get(), &error, sizeof error);
    _exit(127);
  }
  refusal_write = process::FileDescriptor();
  int error = 0;
  ssize_t got;
  do {
    got = ::read(refusal_read.get(), &error, sizeof error);
  } while (got < 0 && errno == EINTR);
  if (got == sizeof error) {
    waitpid(pid, nullptr, 0);
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               "cannot start " + command.front() + ": " + std::strerror(error) +
                                   "; build the whole project first");
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
  if (got == 0) child.output = process::FileDescriptor();
  if (child.output.get() < 0 || !child.running) end_line(child, on_line);
}

}  // namespace tachless::process
