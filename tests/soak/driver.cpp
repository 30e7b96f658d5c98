#include "tests/soak/driver.h"

#include <fmt/core.h>
#include <sys/types.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <utility>

#include "diagnostics/failure.h"
#include "tests/soak/packet_loss.h"

namespace tachless::soak {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr auto slice = 40ms;  // of on_wake, before `supervise` looks at signals again
constexpr std::int64_t traffic_from_tick = 500;
constexpr std::int64_t datagrams_per_tick = 20;
constexpr std::int64_t longest_burst = 3'000;  // some overflow the receivers' buffers

[[noreturn]] void throw_interrupted() {
  throw diagnostics::Failure(diagnostics::ExitCode::interrupted, "interrupted");
}

class Driver {
 public:
  Driver(const Spec& spec, const std::atomic<bool>& interrupted)
      : spec_(spec), interrupted_(interrupted), observer_(spec, traffic_for(spec)) {}

  Observation run() {
    std::optional<PacketLoss> loss;
    if (spec_.round.fault == Fault::loss) loss.emplace(spec_.round.loss_percent);
    launch::SuperviseOptions options;
    options.on_wake = [this] { on_wake(); };
    options.interrupt_grace = 20s;
    const auto begun = Clock::now();
    give_up_at_ = begun + longest_round;
    const launch::Supervision done =
        launch::supervise({{{{"run", spec_.command}}, options}}).front();
    if (done.interrupted || interrupted_) throw_interrupted();
    const auto ended = Clock::now();
    Observation seen;
    seen.end = done.ends.front();
    seen.overdue = overdue_;
    seen.wall_s = std::chrono::duration<double>(ended - begun).count();
    seen.memory = observer_.memory();
    if (traffic_) seen.hostile_datagrams = traffic_->sent();
    seen.fault_made = fault_made_at_.has_value();
    if (fault_made_at_) {
      seen.end_s =
          std::chrono::duration<double>(observer_.gone_since().value_or(ended) - *fault_made_at_)
              .count();
    }
    return seen;
  }

 private:
  HostileTraffic* traffic_for(const Spec& spec) {
    if (spec.round.fault != Fault::hostile) return nullptr;
    return &traffic_.emplace(run_id, spec.round.seed);
  }

  void on_wake() {
    observer_.look_at_processes();
    const auto until = Clock::now() + slice;
    observer_.listen();
    if (const auto launcher = observer_.launcher()) {
      if (Clock::now() > give_up_at_ && !std::exchange(overdue_, true)) kill(*launcher, SIGINT);
      // From before `supervise` caught signals.
      if (interrupted_ && !std::exchange(interruption_sent_, true)) kill(*launcher, SIGINT);
    }
    if (traffic_) {
      send_traffic(until);
    } else {
      make_fault();
    }
  }

  void send_traffic(Clock::time_point until) {
    if (observer_.tick() < traffic_from_tick) return;
    do {  // once at least, however long listening has taken
      if (traffic_->sent() < datagrams_per_tick * observer_.tick()) traffic_->send(longest_burst);
      observer_.listen();
    } while (!observer_.saw_last_tick() && Clock::now() < until);
  }

  /// Whom the fault's signal goes to, and which; nothing when it has none or the process is not up.
  [[nodiscard]] std::optional<std::pair<pid_t, int>> signal_of_fault() const {
    const auto to = [](std::optional<pid_t> pid, int signal) {
      return pid ? std::optional(std::pair(*pid, signal)) : std::nullopt;
    };
    switch (spec_.round.fault) {
      case Fault::kill:
      case Fault::restart:
      case Fault::realtime_kill:
        return to(observer_.process_of(spec_.round.victim), SIGKILL);
      case Fault::pause:
        return to(observer_.process_of(spec_.round.victim), SIGSTOP);
      case Fault::interrupt:
        return to(observer_.launcher(), SIGINT);
      default:
        return std::nullopt;
    }
  }

  void make_fault() {
    if (stopped_ && Clock::now() >= *fault_made_at_ + spec_.round.pause) {
      kill(*std::exchange(stopped_, std::nullopt), SIGCONT);
    }
    const double due = spec_.round.moment * static_cast<double>(spec_.scenario.loop.num_ticks);
    if (fault_made_at_ || static_cast<double>(observer_.tick()) < due) return;
    const auto order = signal_of_fault();
    if (!order) return;
    const auto [pid, signal] = *order;
    kill(pid, signal);
    if (signal == SIGSTOP) stopped_ = pid;
    fault_made_at_ = Clock::now();
  }

  const Spec& spec_;
  const std::atomic<bool>& interrupted_;
  std::optional<HostileTraffic> traffic_;
  Observer observer_;
  bool overdue_ = false;
  bool interruption_sent_ = false;
  std::optional<pid_t> stopped_;
  std::optional<Clock::time_point> fault_made_at_;
  Clock::time_point give_up_at_;
};

}  // namespace

std::optional<std::string> failure_of(const std::vector<std::string>& command) {
  const launch::Supervision done =
      launch::supervise({{{{fs::path(command.front()).filename(), command}}, {}}}).front();
  if (done.interrupted) throw_interrupted();
  if (done.ends.front().well()) return std::nullopt;
  return describe(done.ends.front());
}

Observation drive(const Spec& spec, const std::atomic<bool>& interrupted) {
  return Driver(spec, interrupted).run();
}

}  // namespace tachless::soak
