#include "launch/supervise.h"

#include <fmt/core.h>
#include <poll.h>
#include <signal.h>
#include <sys/signalfd.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <deque>
#include <string_view>
#include <system_error>
#include <utility>

#include "diagnostics/logging.h"
#include "diagnostics/text.h"

namespace tachless::launch {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds wake_interval{50};
constexpr int check_said_no = static_cast<int>(diagnostics::ExitCode::check_said_no);

[[noreturn]] void fail(const char* call) {
  throw std::system_error(errno, std::generic_category(), call);
}

// starts_with, of a line handed over by value: g++ 12 warns falsely of memory that is not set.
bool has_mark(const std::string& line, std::string_view mark) { return line.rfind(mark, 0) == 0; }

/// "tachless-plant: protective stop …" without the program's name.
std::string without_program(const std::string& line) {
  constexpr std::string_view separator = ": ";
  const std::size_t end = line.starts_with("tachless-") ? line.find(separator) : std::string::npos;
  return end == std::string::npos ? line : line.substr(end + separator.size());
}

/// Blocks the signals that end a run, and SIGCHLD, and reads them from a descriptor instead.
class Signals {
 public:
  Signals() {
    sigset_t set;
    sigemptyset(&set);
    for (int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPIPE, SIGCHLD}) sigaddset(&set, signal);
    if (sigprocmask(SIG_BLOCK, &set, &mask_before_) != 0) fail("sigprocmask");
    fd_ = process::FileDescriptor(signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK));
    if (fd_.get() < 0) fail("signalfd");
  }
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;
  ~Signals() { sigprocmask(SIG_SETMASK, &mask_before_, nullptr); }

  [[nodiscard]] int fd() const { return fd_.get(); }
  [[nodiscard]] const sigset_t& mask_before() const { return mask_before_; }

  /// How many signals that end a run have come since the last call.
  int take_interrupts() {
    int count = 0;
    signalfd_siginfo info;
    while (::read(fd_.get(), &info, sizeof info) == sizeof info) {
      if (info.ssi_signo != SIGCHLD) ++count;
    }
    return count;
  }

 private:
  sigset_t mask_before_{};
  process::FileDescriptor fd_;
};

class Run {
 public:
  /// @param mask signals that the processes have blocked
  Run(const Supervised& run, const sigset_t& mask)
      : processes_(run.processes), options_(run.options), mask_(mask) {
    for (const Process& process : processes_) result_.ends.emplace_back().name = process.name;
    try {
      for (const Process& process : processes_) {
        children_.push_back(process::start(process.command, mask, process.cpus));
      }
    } catch (...) {
      kill_rest();
      throw;
    }
  }
  Run(const Run&) = delete;
  Run& operator=(const Run&) = delete;
  ~Run() { kill_rest(); }

  [[nodiscard]] bool any_running() const {
    return std::any_of(children_.begin(), children_.end(),
                       [](const process::Child& child) { return child.running; });
  }
  /// Whether it is being ended before its time because of one of its processes.
  [[nodiscard]] bool failed() const {
    return result_.failed() && terminate_at_ != Clock::time_point::max();
  }
  [[nodiscard]] Supervision result() const { return result_; }

  void add_outputs(std::vector<pollfd>& fds) const {
    for (const process::Child& child : children_) {
      if (child.output.get() >= 0) fds.push_back({child.output.get(), POLLIN, 0});
    }
  }

  /// @param signals how many that end a run have come since the last call
  void attend(int signals) {
    if (!any_running()) return;
    for (std::size_t i = 0; i < children_.size(); ++i) read_output(i);
    pass_on(signals);
    reap();
    if (options_.on_wake) options_.on_wake();
    enforce();
  }

  void interrupt() {
    result_.interrupted = true;
    order(SIGINT);
    terminate_at_ = Clock::now() + options_.interrupt_grace;
  }

  void interrupt_because_of(std::size_t other) {
    if (!any_running() || result_.interrupted || failed()) return;
    result_.because_of = other;
    interrupt();
  }

 private:
  void read_output(std::size_t i) {
    read_lines(children_[i], [&](std::string line) {
      ProcessEnd& end = result_.ends[i];
      if (has_mark(line, diagnostics::error_mark)) {
        end.cause = without_program(line.substr(diagnostics::error_mark.size()));
        return;
      }
      if (has_mark(line, diagnostics::warning_mark)) {
        line.erase(0, diagnostics::warning_mark.size());
      }
      if (options_.on_line) options_.on_line(end.name, line);
      end.last_line = std::move(line);
    });
  }

  void pass_on(int signals) {
    if (signals == 0) return;
    signals_ += signals;
    if (!result_.interrupted) interrupt();
    if (signals_ > 1 && !killed_) {
      order(SIGKILL);
      killed_ = true;
    }
  }

  void reap() {
    for (std::size_t i = 0; i < children_.size(); ++i) {
      process::Child& child = children_[i];
      int status = 0;
      if (!child.running || waitpid(child.pid, &status, WNOHANG) != child.pid) continue;
      child.running = false;
      read_output(i);
      ProcessEnd& end = result_.ends[i];
      if (WIFSIGNALED(status)) end.signal = WTERMSIG(status);
      if (WIFEXITED(status)) end.exit_code = WEXITSTATUS(status);
      end.on_order = ordered_;
      if (end.signal != 0 && may_restart(i)) {
        restart(i);
      } else {
        note_end(i);
      }
    }
  }

  [[nodiscard]] bool may_restart(std::size_t i) const {
    return !processes_[i].restart.empty() && result_.ends[i].restarts < Process::most_restarts &&
           !ordered_ && !clean_end_ && !result_.culprit;
  }

  void restart(std::size_t i) {
    ProcessEnd& end = result_.ends[i];
    const std::string how = describe(end);
    ProcessEnd fresh;
    fresh.name = end.name;
    fresh.restarts = end.restarts + 1;
    end = std::move(fresh);
    children_[i] = process::start(processes_[i].restart, mask_, processes_[i].cpus);
    if (options_.on_restart) options_.on_restart(end.name, how);
  }

  /// A process that went because of a peer is a victim, and says so: blame whoever fails otherwise.
  void note_end(std::size_t i) {
    const ProcessEnd& end = result_.ends[i];
    const Clock::time_point now = Clock::now();
    if (end.failed() && !ordered_) {
      const auto is_victim = [](const ProcessEnd& e) {
        return e.signal == 0 &&
               (e.exit_code == static_cast<int>(diagnostics::ExitCode::peer_lost) ||
                e.cause.starts_with("ended because of "));
      };
      const bool first = !result_.culprit.has_value();
      if (first || (is_victim(result_.ends[*result_.culprit]) && !is_victim(end))) {
        result_.culprit = i;
      }
      if (first && end.signal == 0 && end.exit_code == check_said_no) {
        stragglers_at_ = now + options_.end_together;  // it came to its end, as the others will
      } else {
        terminate_at_ = std::min(terminate_at_, now + options_.grace);
      }
    } else if (!ordered_ && !clean_end_) {
      clean_end_ = true;
      stragglers_at_ = now + options_.end_together;
    }
  }

  void enforce() {
    const Clock::time_point now = Clock::now();
    if (now >= stragglers_at_ && terminate_at_ == Clock::time_point::max() && !ordered_) {
      for (std::size_t i = 0; i < children_.size(); ++i) {
        if (!children_[i].running) continue;
        result_.ends[i].overdue = true;
        if (!result_.culprit) result_.culprit = i;
      }
      terminate_at_ = now;
    }
    if (now >= terminate_at_ && !terminated_) {
      order(SIGTERM);
      terminated_ = true;
      kill_at_ = now + options_.patience;
    }
    if (now >= kill_at_ && !killed_) {
      order(SIGKILL);
      killed_ = true;
    }
  }

  void order(int signal) {
    ordered_ = true;
    for (const process::Child& child : children_) {
      if (!child.running) continue;
      kill(child.pid, signal);
      if (signal == SIGKILL) kill(-child.pid, signal);
      if (signal == SIGTERM) kill(child.pid, SIGCONT);
    }
  }

  void kill_rest() {
    for (process::Child& child : children_) {
      if (!child.running) continue;
      kill(child.pid, SIGKILL);
      waitpid(child.pid, nullptr, 0);
      child.running = false;
    }
  }

  const std::vector<Process>& processes_;
  const SuperviseOptions& options_;
  const sigset_t& mask_;
  std::vector<process::Child> children_;
  Supervision result_;
  int signals_ = 0;  ///< of the user, so far
  bool ordered_ = false;
  bool terminated_ = false;
  bool killed_ = false;
  bool clean_end_ = false;
  Clock::time_point terminate_at_ = Clock::time_point::max();
  Clock::time_point kill_at_ = Clock::time_point::max();
  Clock::time_point stragglers_at_ = Clock::time_point::max();
};

}  // namespace

std::vector<Supervision> supervise(const std::vector<Supervised>& supervised) {
  Signals signals;
  std::deque<Run> runs;
  for (const Supervised& each : supervised) runs.emplace_back(each, signals.mask_before());
  std::optional<std::size_t> first_failed;
  while (std::ranges::any_of(runs, &Run::any_running)) {
    std::vector<pollfd> fds{{signals.fd(), POLLIN, 0}};
    for (const Run& run : runs) run.add_outputs(fds);
    poll(fds.data(), fds.size(), static_cast<int>(wake_interval.count()));
    const int interrupts = signals.take_interrupts();
    for (std::size_t i = 0; i < runs.size(); ++i) {
      runs[i].attend(interrupts);
      if (!first_failed && runs[i].failed()) first_failed = i;
    }
    if (!first_failed) continue;
    for (Run& run : runs) run.interrupt_because_of(*first_failed);
  }
  std::vector<Supervision> results;
  results.reserve(runs.size());
  for (const Run& run : runs) results.push_back(run.result());
  return results;
}

Supervision supervise(const std::vector<Process>& processes, const SuperviseOptions& options) {
  return supervise({Supervised{processes, options}}).front();
}

namespace {

std::string how_it_ended(const ProcessEnd& end) {
  if (end.overdue) return " went on after the others had ended, and was stopped";
  if (end.signal != 0) {
    return fmt::format(" was killed by signal {} ({})", end.signal, strsignal(end.signal));
  }
  return end.exit_code == 0 ? " ended" : fmt::format(" ended with exit code {}", end.exit_code);
}

}  // namespace

std::string describe(const ProcessEnd& end) {
  const bool told = end.signal == 0 && !end.overdue && !end.cause.empty();
  std::string text = end.name + (told ? "" : how_it_ended(end));
  if (end.signal != 0 && end.on_order) text += " because it did not end when told to";
  if (end.restarts > 0) {
    text += fmt::format(", after {} restart{}", end.restarts, end.restarts == 1 ? "" : "s");
  }
  const std::string& words = told ? end.cause : end.last_line;
  if (!words.empty()) text += (end.failed() ? ": " : ", saying: ") + words;
  return text;
}

std::string others_that_failed(const Supervision& supervision) {
  std::vector<std::string> others;
  for (std::size_t i = 0; i < supervision.ends.size(); ++i) {
    const ProcessEnd& end = supervision.ends[i];
    if (i == supervision.culprit || !end.failed()) continue;
    others.push_back(end.signal != 0 ? fmt::format("{} (signal {})", end.name, end.signal)
                                     : fmt::format("{} (exit code {})", end.name, end.exit_code));
  }
  return diagnostics::joined(others);
}

diagnostics::ExitCode exit_code(const Supervision& supervision) {
  if (supervision.interrupted) return diagnostics::ExitCode::interrupted;
  if (!supervision.culprit) return diagnostics::ExitCode::done;
  const ProcessEnd& end = supervision.ends[*supervision.culprit];
  switch (end.signal == 0 ? end.exit_code : 0) {
    case static_cast<int>(diagnostics::ExitCode::check_said_no):
    case static_cast<int>(diagnostics::ExitCode::bad_usage):
    case static_cast<int>(diagnostics::ExitCode::protocol_violated):
    case static_cast<int>(diagnostics::ExitCode::protective_stop):
    case static_cast<int>(diagnostics::ExitCode::interrupted):
      return static_cast<diagnostics::ExitCode>(end.exit_code);
    default:
      break;
  }
  // Whoever was lost, that the robot was stopped matters more.
  const bool stopped =
      std::any_of(supervision.ends.begin(), supervision.ends.end(), [](const ProcessEnd& each) {
        return each.signal == 0 &&
               each.exit_code == static_cast<int>(diagnostics::ExitCode::protective_stop);
      });
  return stopped ? diagnostics::ExitCode::protective_stop : diagnostics::ExitCode::peer_lost;
}

}  // namespace tachless::launch
