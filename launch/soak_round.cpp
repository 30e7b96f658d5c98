#include "launch/soak_round.h"

#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <optional>
#include <span>
#include <system_error>
#include <utility>

#include "bus/authenticated.h"
#include "bus/udp_transport.h"
#include "experiment/scenario.h"
#include "launch/storm.h"
#include "launch/supervise.h"
#include "logger/log_file.h"
#include "logger/run_log.h"
#include "node/options.h"
#include "node/process_options.h"
#include "process/process_tree.h"

namespace tachless::launch {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr std::int64_t run_id = 7;
constexpr double realtime_share = 0.25;  // of the ticks of a lock-step run
constexpr auto promised_end = 2s;
constexpr auto longest_round = 600s;
constexpr std::int64_t promised_growth_kib = 1024;
constexpr auto slice = 40ms;  // of `Watch::on_wake`, before signals are looked at again
constexpr std::int64_t storm_from_tick = 500;
constexpr std::int64_t storm_datagrams_per_tick = 20;
constexpr std::int64_t longest_burst = 3'000;  // some overflow the receivers' buffers

fs::path nft() {
  for (const char* path : {"/usr/sbin/nft", "/sbin/nft", "/usr/bin/nft"}) {
    if (access(path, X_OK) == 0) return path;
  }
  throw diagnostics::Failure(
      diagnostics::ExitCode::bad_usage,
      "packets are lost by nft, which is not there: apt-get install nftables");
}

[[noreturn]] void give_way() {
  throw diagnostics::Failure(diagnostics::ExitCode::interrupted, "interrupted");
}

/// Runs it to its end. @return what it said when it fails, else nothing
std::optional<std::string> failure_of(const std::vector<std::string>& command) {
  const Supervision done = supervise({{fs::path(command.front()).filename(), command}}, {});
  if (done.interrupted) give_way();
  if (!done.ends.front().failed()) return std::nullopt;
  return describe(done.ends.front());
}

void make_directory(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error || access(path.c_str(), W_OK | X_OK) != 0) {
    throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                               "--out " + path.string() +
                                   ": cannot be written to; choose another "
                                   "directory");
  }
}

/// Bytes of a log without the fault that stands behind the last tick of a run that failed.
std::uint64_t bytes_of_ticks(const fs::path& path) {
  logger::LogReader log(path);
  std::uint64_t fault_at = log.size_bytes();
  while (const auto event = log.next()) {
    fault_at = event->channel.ends_with("_PARTICIPANT") ? event->offset : log.size_bytes();
  }
  return fault_at;
}

/// Where the first `size` bytes of `part` differ from the beginning of `whole`; nothing if nowhere.
std::optional<std::uint64_t> first_difference(const fs::path& part, std::uint64_t size,
                                              const fs::path& whole) {
  std::ifstream a(part, std::ios::binary), b(whole, std::ios::binary);
  std::vector<char> x(1 << 16), y(1 << 16);
  for (std::uint64_t at = 0; at < size;) {
    const auto wanted = static_cast<std::streamsize>(std::min<std::uint64_t>(x.size(), size - at));
    a.read(x.data(), wanted);
    b.read(y.data(), wanted);
    const std::streamsize both = std::min(a.gcount(), b.gcount());
    const auto end = std::mismatch(x.begin(), x.begin() + both, y.begin()).first;
    if (end - x.begin() < wanted) return at + static_cast<std::uint64_t>(end - x.begin());
    at += static_cast<std::uint64_t>(wanted);
  }
  return std::nullopt;
}

/// Loses packets of the bus while it lives.
class Loss {
 public:
  explicit Loss(int percent) {
    order({"add", "table", "ip", "soak"});
    order({"add", "chain", "ip", "soak", "in", "{ type filter hook input priority 0; }"});
    order({"add", "rule", "ip", "soak", "in", "udp", "dport", std::to_string(Storm::port), "numgen",
           "random", "mod", "100", "<", std::to_string(percent), "drop"});
  }
  Loss(const Loss&) = delete;
  Loss& operator=(const Loss&) = delete;
  ~Loss() {
    try {
      order({"delete", "table", "ip", "soak"});
    } catch (const std::exception&) {
      // The next round's `add` will say so.
    }
  }

 private:
  static void order(std::vector<std::string> words) {
    words.insert(words.begin(), nft().string());
    if (const auto failure = failure_of(words)) {
      throw diagnostics::Failure(diagnostics::ExitCode::bad_usage,
                                 "cannot make the network lose packets: " + *failure);
    }
  }
};

std::string key_file(const fs::path& directory, std::uint64_t seed) {
  const fs::path path = directory / "soak.key";
  std::ofstream file(path);
  const std::string digits = std::to_string(seed);
  file << std::string(64 - digits.size(), 'a') << digits;
  file.close();
  chmod(path.c_str(), 0600);
  return path.string();
}

}  // namespace

/// One `run`, with what is done to it while it lasts.
class SoakRunner::Play {
 public:
  Play(const SoakRunner& runner, const SoakRound& round, fs::path out)
      : runner_(runner),
        round_(round),
        out_(std::move(out)),
        scenario_path_((runner.scenarios_ / (round.scenario + ".yaml")).string()),
        overrides_(overrides()),
        scenario_(experiment::load_scenario(scenario_path_, overrides_)),
        tick_channel_(loop::channel<loop::Tick>(scenario_.robot.channel_prefix)),
        codec_(loop::Layout{}) {
    fs::remove_all(out_);
    make_directory(out_);
    bus_.subscribe(tick_channel_);
    if (round_.fault == SoakFault::storm) {
      storm_.emplace(run_id, round_.seed);
      bus_.subscribe_all();
    }
  }

  /// @param clean the log that a lock-step run has to equal, or begin; none: this one is the first
  SoakOutcome finish(const std::optional<fs::path>& clean) {
    std::optional<Loss> loss;
    if (round_.fault == SoakFault::loss) loss.emplace(round_.loss_percent);
    Watch watch;
    watch.on_wake = [this] { on_wake(); };
    watch.interrupt_grace = 20s;
    const auto begun = Clock::now();
    give_up_at_ = begun + longest_round;
    const Supervision done = supervise({{"run", command()}}, watch);
    outcome_.wall_s = std::chrono::duration<double>(Clock::now() - begun).count();
    if (done.interrupted || runner_.interrupted_) give_way();
    check_end(done.ends.front());
    check_nobody_is_left();
    check_memory();
    check_log(clean);
    if (storm_) outcome_.hostile_datagrams = storm_->sent();
    return outcome_;
  }

 private:
  [[nodiscard]] std::vector<std::string> overrides() const {
    // A flood can drown heartbeats for long on a busy machine: nobody gives up in lock-step.
    std::vector<std::string> all;
    double share = 1;
    if (round_.realtime()) {
      all.emplace_back("loop.mode=realtime");
      // A machine that stands still, as virtual ones do for 100 ms, is no fault of the loop's. Who
      // is to be missed shall be, so that the robot is at rest in time.
      const bool commands_end =
          round_.fault == SoakFault::realtime_kill &&
          (round_.victim == loop::Role::controller || round_.victim == loop::Role::reference);
      all.emplace_back(commands_end ? "loop.max_missed=300" : "loop.max_missed=1000");
      all.emplace_back("loop.give_up_s=1");
      share = realtime_share;
    } else {
      all.emplace_back("loop.give_up_s=60");
    }
    const double period_s = experiment::load_scenario(scenario_path_).loop.period_s;
    all.push_back("loop.duration_s=" +
                  std::to_string(share * static_cast<double>(runner_.num_ticks_) * period_s));
    return all;
  }

  [[nodiscard]] std::vector<std::string> command() const {
    std::vector<std::string> words = {runner_.program_.string(),
                                      "run",
                                      scenario_path_,
                                      "--quiet",
                                      "--out",
                                      out_.string(),
                                      "--lcm-url",
                                      node::default_lcm_url,
                                      "--run-id",
                                      std::to_string(run_id)};
    for (const std::string& value : overrides_) words.insert(words.end(), {"--set", value});
    if (round_.fault == SoakFault::key) {
      words.insert(words.end(), {"--key-file", key_file(out_, round_.seed)});
    }
    if (round_.fault == SoakFault::restart) {
      words.insert(words.end(), {"--restart", "controller"});
    }
    return words;
  }

  void on_wake() {
    look_at_processes();
    const auto until = Clock::now() + slice;
    listen();
    if (Clock::now() > give_up_at_) {
      problem("still ran after " + std::to_string(longest_round.count()) + " s");
      give_up_at_ = Clock::time_point::max();
      kill(launcher_, SIGINT);
    }
    if (runner_.interrupted_ && !told_ && launcher_ != 0) {  // before `supervise` took signals over
      told_ = true;
      kill(launcher_, SIGINT);
    }
    if (storm_) return blow(until);
    act();
  }

  void look_at_processes() {
    if (launcher_ == 0) {
      const std::vector<pid_t> own = process::children_of(getpid());
      if (own.empty()) return;
      launcher_ = own.front();
    }
    std::map<std::string, pid_t> now;
    for (const pid_t pid : process::children_of(launcher_)) {
      const std::string program = process::program_of(pid);
      if (program.starts_with("tachless-")) now[program] = pid;
    }
    if (now.empty() && acted_ && !gone_at_) gone_at_ = Clock::now();
    processes_ = now;
    // Not of a controller that took over: it has read the log.
    for (const auto& [program, pid] : processes_) first_pids_.try_emplace(program, pid);
    if (tick_ < scenario_.loop.num_ticks / 10) return;
    for (const auto& [program, pid] : processes_) {
      const auto kib = process::resident_kib(pid);
      if (!kib || first_pids_.at(program) != pid) continue;
      SoakMemory& memory = outcome_.memory[program];
      if (memory.early == 0) memory.early = *kib;
      memory.peak = std::max(memory.peak, *kib);
    }
  }

  void listen() {
    while (const auto datagram = bus_.receive(Clock::time_point::min())) take(*datagram);
  }

  void take(const bus::Datagram& datagram) {
    if (storm_) {
      // What `run` says to try the network is not the run's.
      const bool of_run = datagram.channel.starts_with(scenario_.robot.channel_prefix + "_");
      if (!of_run || storm_->is(datagram.sender)) return;
      storm_->hear(datagram.channel, datagram.payload);
    }
    if (datagram.channel != tick_channel_) return;
    loop::Stamp stamp;
    loop::Tick tick;
    std::span<const std::byte> payload = datagram.payload;
    if (round_.fault == SoakFault::key && payload.size() > bus::tag_size) {
      payload = payload.first(payload.size() - bus::tag_size);
    }
    if (codec_.decode(payload, stamp, tick) != bus::Rejection::none) return;
    tick_ = stamp.tick;
    last_ = last_ || tick.last;
    if (storm_) storm_->now_at(tick_);
  }

  void blow(Clock::time_point until) {
    if (tick_ < storm_from_tick) return;
    do {  // once at least, however long listening has taken
      if (storm_->sent() < storm_datagrams_per_tick * tick_) storm_->burst(longest_burst);
      listen();
    } while (!last_ && Clock::now() < until);
  }

  void act() {
    if (stopped_ != 0 && Clock::now() >= resume_at_) kill(std::exchange(stopped_, 0), SIGCONT);
    const bool due =
        static_cast<double>(tick_) >= round_.moment * static_cast<double>(scenario_.loop.num_ticks);
    if (acted_ || !due) return;
    const auto victim = processes_.find(node::program_name(round_.victim));
    switch (round_.fault) {
      case SoakFault::kill:
      case SoakFault::restart:
      case SoakFault::realtime_kill:
        if (victim == processes_.end()) return;
        kill(victim->second, SIGKILL);
        break;
      case SoakFault::pause:
        if (victim == processes_.end()) return;
        stopped_ = victim->second;
        resume_at_ = Clock::now() + round_.pause;
        kill(stopped_, SIGSTOP);
        break;
      case SoakFault::interrupt:
        if (launcher_ == 0) return;
        kill(launcher_, SIGINT);
        break;
      default:
        return;
    }
    acted_ = true;
    acted_at_ = Clock::now();
  }

  void problem(const std::string& text) { outcome_.problems.push_back(text); }

  [[nodiscard]] bool ends_early() const {
    return round_.fault == SoakFault::kill || round_.fault == SoakFault::realtime_kill ||
           round_.fault == SoakFault::interrupt;
  }

  [[nodiscard]] int promised_exit_code() const {
    switch (round_.fault) {
      case SoakFault::kill:
        return static_cast<int>(diagnostics::ExitCode::peer_lost);
      case SoakFault::realtime_kill: {
        // Without these there are no commands, and the robot is stopped for that.
        const bool stops =
            round_.victim == loop::Role::controller || round_.victim == loop::Role::reference;
        return static_cast<int>(stops ? diagnostics::ExitCode::protective_stop
                                      : diagnostics::ExitCode::peer_lost);
      }
      case SoakFault::interrupt:
        return static_cast<int>(diagnostics::ExitCode::interrupted);
      default:
        return static_cast<int>(diagnostics::ExitCode::done);
    }
  }

  void check_end(const ProcessEnd& end) {
    const int promised = promised_exit_code();
    if (end.signal != 0 || end.exit_code != promised) {
      problem(describe(end) + "; promised was exit code " + std::to_string(promised));
    }
    const bool was_to_act =
        ends_early() || round_.fault == SoakFault::pause || round_.fault == SoakFault::restart;
    if (was_to_act && !acted_) return problem("the run ended before its fault");
    if (storm_ && storm_->sent() == 0) return problem("the run ended before the storm");
    if (!ends_early()) return;
    outcome_.end_s =
        std::chrono::duration<double>(gone_at_.value_or(Clock::now()) - acted_at_).count();
    if (outcome_.end_s > std::chrono::duration<double>(promised_end).count()) {
      problem("the processes ended only after " + std::to_string(outcome_.end_s) + " s");
    }
  }

  /// Whoever has lost his parent becomes this process's child.
  void check_nobody_is_left() {
    for (const pid_t pid : process::children_of(getpid())) {
      if (waitpid(pid, nullptr, WNOHANG) == pid) continue;  // had ended by itself
      problem("left behind: process " + std::to_string(pid) + ", " + process::program_of(pid));
      kill(pid, SIGKILL);
      waitpid(pid, nullptr, 0);
    }
  }

  void check_memory() {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    return;  // what is freed is held back by the sanitizer
#endif
    for (const auto& [program, memory] : outcome_.memory) {
      if (memory.peak - memory.early <= promised_growth_kib) continue;
      problem(program + " grew from " + std::to_string(memory.early) + " to " +
              std::to_string(memory.peak) + " KiB");
    }
  }

  void check_log(const std::optional<fs::path>& clean) {
    const fs::path log_path = out_ / "lcmlog";
    std::ifstream summary_file(out_ / "summary.json");
    outcome_.summary = nlohmann::json::parse(summary_file, nullptr, false);
    if (outcome_.summary.is_discarded()) {
      outcome_.summary = nullptr;
      problem("there is no summary.json");
    }
    try {
      logger::RunLog log = logger::RunLog::open(log_path);
      logger::TickRecord record;
      while (log.next(record)) continue;
      if (log.damage().any()) problem("the log is damaged");
      check_ticks(log.summary());
    } catch (const diagnostics::Failure& failure) {
      return problem(failure.what());
    }
    if (clean) {
      const std::uint64_t size = ends_early() ? bytes_of_ticks(log_path) : fs::file_size(log_path);
      const auto at = first_difference(log_path, size, *clean);
      if (at) problem("the log differs from the clean run's, first in byte " + std::to_string(*at));
      if (!ends_early() && fs::file_size(log_path) != fs::file_size(*clean)) {
        problem("the log is not as long as the clean run's");
      }
    }
    if (const auto failure = failure_of({runner_.program_.string(), "replay", log_path.string()})) {
      problem(*failure);
    }
  }

  void check_ticks(const logger::RunSummary& log) {
    const auto ticks = static_cast<std::int64_t>(log.ticks);
    if (ticks == 0) problem("the log has no tick");
    if (!ends_early() && ticks != scenario_.loop.num_ticks) {
      problem("the log has " + std::to_string(ticks) + " of " +
              std::to_string(scenario_.loop.num_ticks) + " ticks");
    }
    for (const logger::Piece piece : logger::all_pieces) {
      const logger::PieceSummary& each = log.of(piece);
      // On the wall clock a busy controller passes over ticks, and the plant goes on without
      // whoever was killed. A run that was ended may lack the last words of its last tick.
      const bool optional =
          piece == logger::Piece::command || piece == logger::Piece::controller_state ||
          (piece == logger::Piece::reference && round_.fault == SoakFault::realtime_kill);
      if (round_.realtime() && optional) continue;
      if (each.missing > (ends_early() ? 1U : 0U)) {
        problem(std::to_string(each.missing) + " ticks have no " + each.channel);
      }
    }
  }

  const SoakRunner& runner_;
  const SoakRound& round_;
  fs::path out_;
  std::string scenario_path_;
  std::vector<std::string> overrides_;
  experiment::Scenario scenario_;
  std::string tick_channel_;
  bus::Codec<loop::Tick> codec_;
  bus::UdpTransport bus_{node::default_lcm_url};
  std::optional<Storm> storm_;
  SoakOutcome outcome_;
  std::int64_t tick_ = -1;
  bool last_ = false;
  pid_t launcher_ = 0;
  std::map<std::string, pid_t> processes_;
  std::map<std::string, pid_t> first_pids_;
  bool told_ = false;
  bool acted_ = false;
  Clock::time_point acted_at_;
  std::optional<Clock::time_point> gone_at_;
  pid_t stopped_ = 0;
  Clock::time_point resume_at_;
  Clock::time_point give_up_at_;
};

SoakRunner::SoakRunner(fs::path program, fs::path directory, fs::path scenarios,
                       std::int64_t num_ticks, const std::atomic<bool>& interrupted)
    : interrupted_(interrupted),
      program_(std::move(program)),
      directory_(std::move(directory)),
      scenarios_(std::move(scenarios)),
      num_ticks_(num_ticks) {
  make_directory(directory_);
  nft();
  clean_up();
  // Each round says all of it itself.
  for (const char* variable : {"TACHLESS_ISOLATE", "TACHLESS_KEY_FILE", "LCM_DEFAULT_URL"}) {
    unsetenv(variable);
  }
  if (prctl(PR_SET_CHILD_SUBREAPER, 1) != 0) {
    throw std::system_error(errno, std::generic_category(), "prctl");
  }
}

SoakOutcome SoakRunner::play(const SoakRound& round) {
  if (round.realtime()) return Play(*this, round, last()).finish({});
  const fs::path clean = directory_ / ("soak-clean-" + round.scenario);
  if (!fs::exists(clean)) {
    SoakRound first = round;
    first.fault = SoakFault::none;
    SoakOutcome outcome = Play(*this, first, clean).finish({});
    if (!outcome.problems.empty()) {
      fs::remove_all(last());
      fs::rename(clean, last());
      return outcome;
    }
  }
  return Play(*this, round, last()).finish(clean / "lcmlog");
}

void SoakRunner::clean_up() {
  for (const auto& entry : fs::directory_iterator(directory_)) {
    const std::string name = entry.path().filename();
    if (name == "soak-round" || name.starts_with("soak-clean-")) fs::remove_all(entry.path());
  }
}

}  // namespace tachless::launch
