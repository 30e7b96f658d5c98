#include "tests/soak/judge.h"

#include <fmt/core.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <fstream>

#include "diagnostics/failure.h"
#include "logger/log_file.h"
#include "logger/run_log.h"
#include "process/process_tree.h"
#include "tests/support/process_facts.h"

namespace tachless::soak {
namespace {

namespace fs = std::filesystem;

constexpr double promised_end_s = 2;

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

class Judge {
 public:
  Judge(const Spec& spec, const Observation& seen) : spec_(spec), seen_(seen) {}

  Verdict verdict(const std::optional<fs::path>& clean) {
    check_end();
    check_nobody_is_left();
    check_memory();
    check_log(clean);
    if (!verdict_.problems.empty() && verdict_.summary.is_object() &&
        verdict_.summary.value("fault", nlohmann::json()).is_string()) {
      problem("the run says: " + verdict_.summary["fault"].get<std::string>());
    }
    return verdict_;
  }

 private:
  void problem(std::string text) { verdict_.problems.push_back(std::move(text)); }

  [[nodiscard]] diagnostics::ExitCode promised_exit_code() const {
    switch (spec_.round.fault) {
      case Fault::kill:
        return diagnostics::ExitCode::peer_lost;
      case Fault::realtime_kill: {
        // Without these there are no commands, and the robot is stopped for that.
        const loop::Role victim = spec_.round.victim;
        return victim == loop::Role::controller || victim == loop::Role::reference
                   ? diagnostics::ExitCode::protective_stop
                   : diagnostics::ExitCode::peer_lost;
      }
      case Fault::interrupt:
        return diagnostics::ExitCode::interrupted;
      default:
        return diagnostics::ExitCode::done;
    }
  }

  void check_end() {
    if (seen_.overdue) problem(fmt::format("still ran after {} s", longest_round.count()));
    const int promised = static_cast<int>(promised_exit_code());
    if (seen_.end.signal != 0 || seen_.end.exit_code != promised) {
      problem(fmt::format("{}; promised was exit code {}", describe(seen_.end), promised));
    }
    const Fault fault = spec_.round.fault;
    const bool has_moment = spec_.ends_early() || fault == Fault::pause || fault == Fault::restart;
    if (has_moment && !seen_.fault_made) return problem("the run ended before its fault");
    if (fault == Fault::hostile && seen_.hostile_datagrams == 0) {
      return problem("the run ended before the first hostile datagram");
    }
    if (spec_.ends_early() && seen_.end_s > promised_end_s) {
      problem(fmt::format("the processes ended only after {:.3f} s", seen_.end_s));
    }
  }

  void check_nobody_is_left() {
    for (const pid_t pid : process::children_of(getpid())) {
      if (waitpid(pid, nullptr, WNOHANG) == pid) continue;  // had ended by itself
      problem(fmt::format("left behind: process {}, {}", pid, support::program_of(pid)));
      kill(pid, SIGKILL);
      waitpid(pid, nullptr, 0);
    }
  }

  void check_memory() {
    for (const auto& [program, memory] : seen_.memory) {
      if (memory.peak - memory.early <= spec_.most_growth_kib) continue;
      problem(fmt::format("{} grew from {} to {} KiB", program, memory.early, memory.peak));
    }
  }

  void check_log(const std::optional<fs::path>& clean) {
    const fs::path log_path = spec_.out / "lcmlog";
    std::ifstream summary_file(spec_.out / "summary.json");
    verdict_.summary = nlohmann::json::parse(summary_file, nullptr, false);
    if (verdict_.summary.is_discarded()) {
      verdict_.summary = nullptr;
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
    if (clean) compare(log_path, *clean);
    if (const auto failure = failure_of({spec_.program, "replay", log_path})) problem(*failure);
  }

  void compare(const fs::path& log_path, const fs::path& clean) {
    const bool cut = spec_.ends_early();
    const std::uint64_t size = cut ? bytes_of_ticks(log_path) : fs::file_size(log_path);
    if (const auto at = first_difference(log_path, size, clean)) {
      problem(fmt::format("the log differs from the clean run's, first in byte {}", *at));
    }
    if (!cut && fs::file_size(log_path) != fs::file_size(clean)) {
      problem("the log is not as long as the clean run's");
    }
  }

  void check_ticks(const logger::RunSummary& log) {
    const auto ticks = static_cast<std::int64_t>(log.ticks);
    if (ticks == 0) problem("the log has no tick");
    if (!spec_.ends_early() && ticks != spec_.scenario.loop.num_ticks) {
      problem(fmt::format("the log has {} of {} ticks", ticks, spec_.scenario.loop.num_ticks));
    }
    for (const loop::Slot piece : loop::all_slots) {
      const logger::PieceSummary& each = log.of(piece);
      // On the wall clock a busy controller skips ticks, and the plant goes on without whoever was
      // killed. A run that was ended may lack messages of its last tick.
      const bool optional =
          piece == loop::Slot::command || piece == loop::Slot::controller_state ||
          (piece == loop::Slot::reference && spec_.round.fault == Fault::realtime_kill);
      if (spec_.round.realtime() && optional) continue;
      if (each.missing.count > (spec_.ends_early() ? 1U : 0U)) {
        problem(fmt::format("{} ticks have no {}", each.missing.count, each.channel));
      }
    }
  }

  const Spec& spec_;
  const Observation& seen_;
  Verdict verdict_;
};

}  // namespace

Verdict judge(const Spec& spec, const Observation& seen, const std::optional<fs::path>& clean) {
  return Judge(spec, seen).verdict(clean);
}

}  // namespace tachless::soak
