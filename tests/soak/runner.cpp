#include "tests/soak/runner.h"

#include <sys/prctl.h>

#include <cerrno>
#include <cstdlib>
#include <string>
#include <system_error>
#include <utility>

#include "tests/soak/packet_loss.h"

namespace tachless::soak {

namespace fs = std::filesystem;

Runner::Runner(Setting setting, const std::atomic<bool>& interrupted)
    : setting_(std::move(setting)), interrupted_(interrupted) {
  make_directory(setting_.directory);
  PacketLoss::require();
  clean_up();
  // Each round gives these as options.
  for (const char* variable : {"TACHLESS_ISOLATE", "TACHLESS_KEY_FILE", "LCM_DEFAULT_URL"}) {
    unsetenv(variable);
  }
  if (prctl(PR_SET_CHILD_SUBREAPER, 1) != 0) {
    throw std::system_error(errno, std::generic_category(), "prctl");
  }
}

Outcome Runner::run(const Round& round, const fs::path& out, const std::optional<fs::path>& clean) {
  const Spec spec = specify(setting_, round, out);
  Outcome outcome;
  outcome.seen = drive(spec, interrupted_);
  outcome.verdict = judge(spec, outcome.seen, clean);
  return outcome;
}

Outcome Runner::run(const Round& round) {
  if (round.realtime()) return run(round, last(), std::nullopt);
  const fs::path clean = setting_.directory / ("soak-clean-" + round.scenario);
  if (!fs::exists(clean)) {
    Round first = round;
    first.fault = Fault::none;
    Outcome outcome = run(first, clean, std::nullopt);
    if (!outcome.verdict.problems.empty()) {
      fs::remove_all(last());
      fs::rename(clean, last());
      return outcome;
    }
  }
  return run(round, last(), clean / "lcmlog");
}

void Runner::clean_up() {
  for (const auto& entry : fs::directory_iterator(setting_.directory)) {
    const std::string name = entry.path().filename();
    if (name == "soak-round" || name.starts_with("soak-clean-")) fs::remove_all(entry.path());
  }
}

}  // namespace tachless::soak
