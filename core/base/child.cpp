#include "base/child.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <condition_variable>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <future>
#include <mutex>
#include <sstream>
#include <system_error>
#include <thread>
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

constexpr const char* notice_variable = "TACHLESS_NOTICE_FD";

struct Pipe {
  Pipe() {
    std::array<int, 2> ends{};
    if (pipe2(ends.data(), O_CLOEXEC) != 0) fail("pipe2");
    read = FileDescriptor(ends[0]);
    write = FileDescriptor(ends[1]);
  }
  FileDescriptor read, write;
};

void do_not_wait(const FileDescriptor& end) {
  if (fcntl(end.get(), F_SETFL, O_NONBLOCK) != 0) fail("fcntl");
}

/// Passes bytes from descriptor `in` to `out`, and never waits for `out` alone. Keeps the newest
/// bytes when `out` is full. Calls only functions that are safe after a fork.
[[noreturn]] void relay(int in, int out) {
  static std::array<char, 1U << 18> ring;
  static std::array<char, 1U << 16> chunk;
  std::uint64_t begin = 0, end = 0, dropped = 0;
  while (in >= 0 || begin < end || dropped > 0) {
    std::array<pollfd, 2> fds{pollfd{in, POLLIN, 0},
                              pollfd{out, static_cast<short>(begin < end ? POLLOUT : 0), 0}};
    poll(fds.data(), fds.size(), -1);
    if ((fds[1].revents & (POLLERR | POLLNVAL)) != 0) break;
    if (in >= 0 && fds[0].revents != 0) {
      const ssize_t got = ::read(in, chunk.data(), chunk.size());
      if (got <= 0) in = -1;
      for (ssize_t i = 0; i < got; ++i) ring[end++ % ring.size()] = chunk[i];
      if (end - begin > ring.size()) {
        dropped += end - begin - ring.size();
        begin = end - ring.size();
      }
    }
    if (dropped > 0) {
      std::array<char, 48> note{};
      const auto end_of_note =
          fmt::format_to_n(note.data(), note.size(), "\n{}{}\n", dropped_mark, dropped);
      if (::write(out, note.data(), end_of_note.size) > 0) dropped = 0;
    }
    if (dropped > 0 || begin == end) continue;
    const std::size_t from = begin % ring.size();
    const std::size_t most = std::min<std::size_t>(end - begin, ring.size() - from);
    const ssize_t written = ::write(out, &ring[from], most);
    if (written > 0) begin += static_cast<std::uint64_t>(written);
  }
  _exit(0);
}

/// Starts a relay between the pipes. It is no child of this process and ends with its pipes.
void start_relay(const FileDescriptor& in, const FileDescriptor& out) {
  fcntl(in.get(), F_SETPIPE_SZ, 1 << 20);  // refused: it stays at 64 kB
  do_not_wait(out);
  const pid_t pid = fork();
  if (pid < 0) fail("fork");
  if (pid > 0) {
    while (waitpid(pid, nullptr, 0) < 0 && errno == EINTR) continue;
    return;
  }
  if (fork() != 0) _exit(0);
  setsid();
  std::signal(SIGPIPE, SIG_IGN);
  const int from = fcntl(in.get(), F_DUPFD, 10), to = fcntl(out.get(), F_DUPFD, 10);
  const int nothing = ::open("/dev/null", O_RDWR);
  for (int standard : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) dup2(nothing, standard);
  dup2(from, 3);
  dup2(to, 4);
  close_range(5, ~0U, 0);
  relay(3, 4);
}

/// This process's environment and, where the child reports, the variable that names its descriptor.
std::vector<char*> environment(std::string& notice_setting) {
  std::vector<char*> all;
  for (char** each = environ; each != nullptr && *each != nullptr; ++each) {
    if (!std::string_view(*each).starts_with(std::string(notice_variable) + "=")) {
      all.push_back(*each);
    }
  }
  if (!notice_setting.empty()) all.push_back(notice_setting.data());
  all.push_back(nullptr);
  return all;
}

/// `start` from a thread that lives as long as this process.
Child start_here(const std::vector<std::string>& command, const StartOptions& options) {
  Pipe output, refusal;  // the second carries errno when exec fails; exec closes it
  if (options.relayed) {
    Pipe relayed;
    start_relay(output.read, relayed.write);
    output.read = std::move(relayed.read);
  }
  do_not_wait(output.read);
  std::optional<Pipe> notices;
  std::string notice_setting;
  if (options.gives_notices) {
    notices.emplace();
    do_not_wait(notices->read);
    do_not_wait(notices->write);
    notice_setting = fmt::format("{}={}", notice_variable, notices->write.get());
  }
  const std::vector<char*> argv = arguments(command), envp = environment(notice_setting);
  const pid_t parent = getpid();
  const pid_t pid = fork();
  if (pid < 0) fail("fork");
  if (pid == 0) {
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    const int input =
        options.input >= 0 ? options.input : ::open("/dev/null", O_RDONLY | O_CLOEXEC);
    if (notices) fcntl(notices->write.get(), F_SETFD, 0);
    if (getppid() == parent && input >= 0 && dup2(input, STDIN_FILENO) >= 0 &&
        dup2(output.write.get(), STDOUT_FILENO) >= 0 &&
        dup2(output.write.get(), STDERR_FILENO) >= 0 &&
        sigprocmask(SIG_SETMASK, &*options.mask, nullptr) == 0 && execute_on(options.cpus)) {
      execvpe(argv[0], argv.data(), envp.data());
    }
    const int error = errno;
    [[maybe_unused]] const ssize_t written = ::write(refusal.write.get(), &error, sizeof error);
    _exit(127);
  }
  refusal.write = FileDescriptor();
  int error = 0;
  ssize_t got;
  do {
    got = ::read(refusal.read.get(), &error, sizeof error);
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
  child.output = std::move(output.read);
  if (notices) child.notices = std::move(notices->read);
  return child;
}

/// Starts programs for threads that may end before them: PR_SET_PDEATHSIG follows the thread that
/// forked. Lives as long as this process.
class Starter {
 public:
  static Starter& instance() {
    static Starter* const starter = new Starter;
    return *starter;
  }

  Child start(const std::vector<std::string>& command, const StartOptions& options) {
    std::packaged_task<Child()> task([&] { return start_here(command, options); });
    std::future<Child> result = task.get_future();
    {
      const std::lock_guard lock(mutex_);
      tasks_.push_back(std::move(task));
    }
    wake_.notify_one();
    return result.get();
  }

 private:
  Starter() {
    std::thread([this] {
      sigset_t all;
      sigfillset(&all);
      pthread_sigmask(SIG_BLOCK, &all, nullptr);  // signals are for the other threads
      for (std::unique_lock lock(mutex_);;) {
        wake_.wait(lock, [this] { return !tasks_.empty(); });
        std::packaged_task<Child()> task = std::move(tasks_.front());
        tasks_.pop_front();
        lock.unlock();
        task();
        lock.lock();
      }
    }).detach();
  }

  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<std::packaged_task<Child()>> tasks_;
};

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

Child start(const std::vector<std::string>& command, const StartOptions& options) {
  std::signal(SIGCHLD, SIG_DFL);  // ignored, as it may be inherited, it would leave no end to take
  StartOptions wanted = options;
  if (!wanted.mask) wanted.mask = blocked_signals();
  if (gettid() == getpid()) return start_here(command, wanted);
  return Starter::instance().start(command, wanted);
}

bool read_lines(Child& child, const std::function<void(std::string)>& on_line) {
  constexpr int most_reads = 16;
  std::array<char, 4096> buffer;
  ssize_t got = -1;
  int reads = 0;
  while (child.output.get() >= 0 && reads < most_reads &&
         (got = ::read(child.output.get(), buffer.data(), buffer.size())) > 0) {
    ++reads;
    for (const char c : std::string_view(buffer.data(), static_cast<std::size_t>(got))) {
      if (c != '\n') child.partial += c;
      if (c == '\n' || child.partial.size() >= longest_line) end_line(child, on_line);
    }
  }
  if (reads == most_reads) return true;
  if (got == 0) child.output = FileDescriptor();
  if (child.output.get() < 0 || !child.running) end_line(child, on_line);
  return false;
}

void read_rest(Child& child, std::chrono::milliseconds patience,
               const std::function<void(std::string)>& on_line) {
  const auto deadline = Clock::now() + patience;
  child.running = true;  // a line that has not ended may go on
  while (child.output.get() >= 0 && Clock::now() < deadline) {
    await_output(child, 20);
    read_lines(child, on_line);
  }
  child.running = false;
  end_line(child, on_line);
}

std::vector<Notice> take_notices(Child& child) {
  std::vector<Notice> notices;
  char each = 0;
  while (child.notices.get() >= 0 && ::read(child.notices.get(), &each, 1) == 1) {
    notices.push_back(static_cast<Notice>(each));
  }
  return notices;
}

void give_notice(Notice notice) noexcept {
  const char* const variable = std::getenv(notice_variable);
  if (variable == nullptr) return;
  const char byte = static_cast<char>(notice);
  [[maybe_unused]] const ssize_t written = ::write(std::atoi(variable), &byte, 1);
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
  constexpr int most_shares = 32;  // a pipe holds at most 1 MB
  for (int i = 0; i < most_shares && read_lines(child, on_line); ++i) continue;
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
