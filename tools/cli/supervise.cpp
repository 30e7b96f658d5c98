#include "cli/supervise.h"

#include <fmt/core.h>
#include <poll.h>
#include <signal.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <deque>
#include <system_error>
#include <utility>

#include "base/logging.h"
#include "base/text.h"
#include "base/this_process.h"

namespace tachless::cli {
namespace {

using base::ExitCode;
using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds wake_interval{50};
constexpr Clock::time_point never = Clock::time_point::max();
/// A process may hold the pipe of one that has ended. This bounds its delay of the run's end.
constexpr std::chrono::milliseconds rest_of_output{2000};
constexpr std::chrono::seconds reminder_interval{1};

[[noreturn]] void fail(const char* call) {
  throw std::system_error(errno, std::generic_category(), call);
}

// starts_with, of a line handed over by value: g++ 12 warns falsely of memory that is not set.
bool has_mark(const std::string& line, std::string_view mark) { return line.rfind(mark, 0) == 0; }

/// Returns "tachless-plant: protective stop …" without the program's name.
std::string without_program(const std::string& line) {
  constexpr std::string_view separator = ": ";
  const std::size_t end = line.starts_with("tachless-") ? line.find(separator) : std::string::npos;
  return end == std::string::npos ? line : line.substr(end + separator.size());
}

/// Returns whether a process ended by itself with this code.
bool ended_with(const ProcessEnd& end, ExitCode code) {
  return end.signal == 0 && end.exit_code == static_cast<int>(code);
}

/// Returns a process's distance from the first cause. The nearest ended by itself, the next because
/// it missed a peer, the last because of a peer's announcement.
int distance_from_cause(const ProcessEnd& end) {
  if (end.signal == 0 && end.cause.starts_with("ended because of ")) return 2;
  return ended_with(end, ExitCode::peer_lost) ? 1 : 0;
}

/// The signals that end a run, and SIGCHLD: blocked, and read from a descriptor instead.
class Signals {
 public:
  Signals() {
    sigset_t set;
    sigemptyset(&set);
    for (int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPIPE, SIGCHLD}) sigaddset(&set, signal);
    if (sigprocmask(SIG_BLOCK, &set, &mask_before_) != 0) fail("sigprocmask");
    fd_ = base::FileDescriptor(signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK));
    if (fd_.get() < 0) fail("signalfd");
  }
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;
  ~Signals() { sigprocmask(SIG_SETMASK, &mask_before_, nullptr); }

  [[nodiscard]] int fd() const { return fd_.get(); }
  [[nodiscard]] const sigset_t& mask_before() const { return mask_before_; }

  /// Returns the number of signals that end a run since the last call.
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
  base::FileDescriptor fd_;
};

class Run {
 public:
  /// Starts nothing yet. @param mask signals that the processes have blocked
  Run(const Supervised& run, const sigset_t& mask)
      : processes_(run.processes), options_(run.options), mask_(mask) {}
  Run(const Run&) = delete;
  Run& operator=(const Run&) = delete;
  ~Run() {
    for (std::size_t i = 0; i < children_.size(); ++i) {
      if (!children_[i].running) continue;
      kill(children_[i].pid, holds_robot(i) ? SIGTERM : SIGKILL);
      if (!holds_robot(i)) base::take_end(children_[i], true);
    }
  }

  void start() {
    for (const Process& process : processes_) {
      result_.ends.emplace_back().name = process.name;
      base::StartOptions options{.mask = mask_, .cpus = process.cpus};
      options.relayed = process.relayed;
      options.gives_notices = process.drives_robot;
      children_.push_back(base::start(process.command, options));
    }
    shown_.resize(children_.size());
    stopped_at_.resize(children_.size(), never);
  }

  [[nodiscard]] bool any_running() const {
    return std::ranges::any_of(children_, &base::Child::running);
  }
  /// Returns whether the run is being ended early because of one of its processes.
  [[nodiscard]] bool failed() const {
    return result_.failed() && (sent_ != 0 || escalate_at_ != never);
  }
  [[nodiscard]] const Supervision& result() const { return result_; }

  void add_outputs(std::vector<pollfd>& fds) const {
    if (!any_running()) return;  // only another program still holds an output
    for (const base::Child& child : children_) {
      if (child.output.get() >= 0) fds.push_back({child.output.get(), POLLIN, 0});
    }
  }

  /// @param signals number of signals that end a run since the last call
  void attend(int signals) {
    if (!any_running()) return;
    for (std::size_t i = 0; i < children_.size(); ++i) read_output(i);
    read_notices();
    signals_ += signals;
    if (signals > 0 && !result_.interrupted) interrupt();
    if (signals_ > 1 && (sent_ != SIGKILL || signals > 0)) send(SIGKILL, never);
    for (std::size_t i = 0; i < children_.size(); ++i) reap(i);
    if (options_.on_wake) options_.on_wake();
    enforce();
    if (sent_ != 0) attend_drivers();
  }

  void interrupt_because_of(std::size_t other) {
    if (!any_running() || result_.interrupted || failed()) return;
    result_.because_of = other;
    interrupt();
  }

 private:
  void interrupt() {
    result_.interrupted = true;
    if (sent_ == 0) return send(SIGINT, Clock::now() + options_.interrupt_grace);
    signal_all(SIGINT);  // also to processes that ignored SIGTERM
  }

  void read_output(std::size_t i) {
    base::read_lines(children_[i], [&](std::string line) { on_line(i, std::move(line)); });
  }

  void on_line(std::size_t i, std::string line) {
    ProcessEnd& end = result_.ends[i];
    if (has_mark(line, base::error_mark)) {
      end.cause = without_program(line.substr(base::error_mark.size()));
      return;
    }
    if (has_mark(line, base::dropped_mark)) {
      end.dropped_bytes += std::atoll(line.c_str() + base::dropped_mark.size());
      return;
    }
    const bool detail = has_mark(line, "<info> ") || has_mark(line, "<debug> ");
    if (detail || has_mark(line, base::warning_mark)) line.erase(0, line.find(' ') + 1);
    line = without_program(line);
    show(i, line);
    if (!detail) end.last_line = std::move(line);
  }

  /// Passes on a line, unless the process has written too many in this second.
  void show(std::size_t i, const std::string& line) {
    const Clock::time_point now = Clock::now();
    Shown& shown = shown_[i];
    if (now - shown.since >= std::chrono::seconds(1)) shown = {now, 0};
    if (++shown.lines > options_.most_lines_per_s) {
      ++result_.ends[i].hidden_lines;
    } else if (options_.on_line) {
      options_.on_line(result_.ends[i].name, line);
    }
  }

  void read_notices() {
    for (std::size_t i = 0; i < children_.size(); ++i) {
      for (const base::Notice notice : base::take_notices(children_[i])) {
        result_.ends[i].robot_started = true;
        result_.ends[i].robot_stopped = notice == base::Notice::robot_stopped;
        stopped_at_[i] = result_.ends[i].robot_stopped ? Clock::now() : never;
      }
    }
  }

  /// Returns whether process `i` has started its robot and not stopped it.
  [[nodiscard]] bool holds_robot(std::size_t i) const {
    return result_.ends[i].robot_started && !result_.ends[i].robot_stopped;
  }

  /// Names the emergency stop while a driver has not stopped its robot. It kills a driver that has
  /// stopped its robot and does not end.
  void attend_drivers() {
    const Clock::time_point now = Clock::now();
    bool remind = false;
    for (std::size_t i = 0; i < children_.size(); ++i) {
      if (!children_[i].running || !result_.ends[i].robot_started) continue;
      if (holds_robot(i)) {
        remind = now >= remind_at_;
        if (!remind || !options_.on_line) continue;
        options_.on_line(result_.ends[i].name,
                         "the driver has not stopped the robot yet: use the emergency stop; the "
                         "third Ctrl-C kills the driver");
      } else if (sent_ == SIGKILL && now >= stopped_at_[i] + options_.patience) {
        kill(-children_[i].pid, SIGKILL);
      }
    }
    if (remind || remind_at_ == Clock::time_point()) remind_at_ = now + reminder_interval;
  }

  void reap(std::size_t i) {
    const auto how = base::take_end(children_[i]);
    if (!how) return;
    base::read_rest(children_[i], rest_of_output,
                    [&](std::string line) { on_line(i, std::move(line)); });
    read_notices();
    ProcessEnd& end = result_.ends[i];
    static_cast<base::End&>(end) = *how;
    end.on_order = sent_ != 0;
    note_end(i);
  }

  /// Notes the end of process `i`. The first process that fails is the culprit. A process that is
  /// nearer to the first cause replaces it.
  void note_end(std::size_t i) {
    if (sent_ != 0) return;
    const ProcessEnd& end = result_.ends[i];
    const Clock::time_point now = Clock::now();
    const bool first = !result_.culprit.has_value();
    if (first && !clean_end_) result_.begun = !options_.begun || options_.begun();
    if (end.well()) {
      const auto time = result_.begun ? options_.end_together : options_.grace;
      if (!clean_end_) stragglers_at_ = now + time;
      clean_end_ = true;
      return;
    }
    if (first || distance_from_cause(end) < distance_from_cause(result_.ends[*result_.culprit])) {
      result_.culprit = i;
    }
    // A plant that missed deadlines came to its end, and the others will too. A user's program did
    // not come to its end.
    if (first && result_.begun && end.name == "plant" && ended_with(end, ExitCode::check_said_no)) {
      stragglers_at_ = now + options_.end_together;
    } else {
      escalate_at_ = std::min(escalate_at_, now + options_.grace);
    }
  }

  void enforce() {
    const Clock::time_point now = Clock::now();
    if (now >= stragglers_at_ && escalate_at_ == never && sent_ == 0) {
      for (std::size_t i = 0; i < children_.size(); ++i) {
        if (!children_[i].running) continue;
        result_.ends[i].overdue = true;
        if (!result_.culprit) result_.culprit = i;
      }
      escalate_at_ = now;
    }
    if (now < escalate_at_) return;
    sent_ == SIGTERM ? send(SIGKILL, never) : send(SIGTERM, now + options_.patience);
  }

  /// Sends `signal` to all processes that run. The next signal follows at `then`.
  void send(int signal, Clock::time_point then) {
    sent_ = signal;
    escalate_at_ = then;
    signal_all(signal);
  }

  void signal_all(int signal) const {
    constexpr int kills_drivers = 3;
    for (std::size_t i = 0; i < children_.size(); ++i) {
      const base::Child& child = children_[i];
      if (!child.running) continue;
      if (signal == SIGKILL && result_.ends[i].robot_started && signals_ < kills_drivers) continue;
      kill(child.pid, signal);
      if (signal == SIGKILL) kill(-child.pid, signal);
      if (signal == SIGTERM) kill(child.pid, SIGCONT);
    }
  }

  const std::vector<Process>& processes_;
  const SuperviseOptions& options_;
  const sigset_t& mask_;
  std::vector<base::Child> children_;
  Supervision result_;
  struct Shown {
    Clock::time_point since;
    int lines = 0;
  };
  std::vector<Shown> shown_;                   ///< of each child's lines in this second
  std::vector<Clock::time_point> stopped_at_;  ///< when each child has stopped its robot
  Clock::time_point remind_at_{};              ///< of a robot that is not stopped
  int signals_ = 0;                            ///< of the user, so far
  int sent_ = 0;  ///< last signal to the processes: SIGINT, SIGTERM, SIGKILL; 0: none
  bool clean_end_ = false;
  Clock::time_point escalate_at_ = never;    ///< when the next signal follows
  Clock::time_point stragglers_at_ = never;  ///< when a process that still runs is late
};

}  // namespace

Placement choose_placement(const std::string& wanted, scenario::Mode mode, std::size_t index) {
  if (wanted != "auto" && wanted != "none") {
    throw base::bad_usage(
        "--placement {}: allowed: auto, none; for other CPUs start the programs with taskset",
        wanted);
  }
  Placement placement;
  std::vector<int> cpus = base::allowed_cpus();
  if (wanted == "none" || mode == scenario::Mode::realtime || cpus.size() == 1) return placement;
  // At most one of the three computes at a time, and waking a process on another CPU takes longer
  // than on the same one. Runs side by side are distinguished by the launcher's process number.
  const int cpu = cpus[(static_cast<std::size_t>(getpid()) + index) % cpus.size()];
  for (const messages::Role role :
       {messages::Role::plant, messages::Role::controller, messages::Role::reference}) {
    placement.cpus[static_cast<std::size_t>(role)] = {cpu};
  }
  std::erase(cpus, cpu);
  placement.cpus[static_cast<std::size_t>(messages::Role::logger)] = cpus;
  placement.words = fmt::format("together on CPU {}", cpu);
  return placement;
}

std::vector<Supervision> supervise(const std::vector<Supervised>& supervised) {
  Signals signals;
  std::deque<Run> runs;
  for (const Supervised& each : supervised) {
    runs.emplace_back(each, signals.mask_before()).start();
  }
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

std::string describe(const ProcessEnd& end) {
  const bool has_cause = end.signal == 0 && !end.overdue && !end.cause.empty();
  std::string text = end.name;
  if (end.overdue) {
    text += " was still running after the others had ended; stopped";
  } else if (!has_cause) {
    text += " " + base::text(end);
  }
  if (end.signal != 0 && end.on_order) text += " because it did not end on SIGTERM";
  const std::string& words = has_cause ? end.cause : end.last_line;
  if (!words.empty()) text += (end.well() ? ", saying: " : ": ") + words;
  return text;
}

std::string others_that_failed(const Supervision& supervision) {
  std::vector<std::string> others;
  for (std::size_t i = 0; i < supervision.ends.size(); ++i) {
    const ProcessEnd& end = supervision.ends[i];
    if (i == supervision.culprit || end.well()) continue;
    others.push_back(end.signal != 0 ? fmt::format("{} (signal {})", end.name, end.signal)
                                     : fmt::format("{} (exit code {})", end.name, end.exit_code));
  }
  return base::joined(others);
}

ExitCode exit_code(const Supervision& supervision) {
  if (supervision.interrupted) return ExitCode::interrupted;
  if (!supervision.culprit) return ExitCode::done;
  for (const ExitCode own :
       {ExitCode::check_said_no, ExitCode::bad_usage, ExitCode::protocol_violated,
        ExitCode::protective_stop, ExitCode::interrupted}) {
    const ProcessEnd& culprit = supervision.ends[*supervision.culprit];
    // Our checks are those of the plant and the logger in a run that has begun.
    if (own == ExitCode::check_said_no && (!supervision.begun || culprit.name == "controller")) {
      continue;
    }
    if (ended_with(culprit, own)) return own;
  }
  // A stopped robot matters more than the name of the lost process.
  const bool stopped = std::ranges::any_of(supervision.ends, [](const ProcessEnd& each) {
    return ended_with(each, ExitCode::protective_stop);
  });
  return stopped ? ExitCode::protective_stop : ExitCode::peer_lost;
}

}  // namespace tachless::cli
