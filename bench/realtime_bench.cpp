// A realtime run and cyclictest (Debian's rt-tests) in the same seconds, and what each saw of the
// machine: both wake up every millisecond, at SCHED_FIFO 80.
//   realtime_bench [SECONDS [SCENARIO]]

#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/program.h"

namespace {

/// Latencies [us], as cyclictest's --histogram prints them.
class Histogram {
 public:
  explicit Histogram(const std::string& text) {
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      if (line.starts_with("# Histogram Overflows:")) {
        overflows_ = std::atoll(line.substr(line.find(':') + 1).c_str());
      }
      if (line.empty() || line.front() == '#') continue;
      std::istringstream words(line);
      std::int64_t latency = 0, times = 0;
      if (words >> latency >> times && times > 0) bins_.emplace_back(latency, times);
      total_ += times;
    }
    if (bins_.empty()) throw std::runtime_error("cyclictest says: " + text);
  }
  [[nodiscard]] std::int64_t total() const { return total_; }
  [[nodiscard]] std::int64_t overflows() const { return overflows_; }
  [[nodiscard]] std::int64_t longest() const { return bins_.back().first; }
  [[nodiscard]] std::int64_t quantile(double q) const {
    std::int64_t seen = 0;
    for (const auto& [latency, times] : bins_) {
      seen += times;
      if (static_cast<double>(seen) >= q * static_cast<double>(total_)) return latency;
    }
    return longest();
  }

 private:
  std::vector<std::pair<std::int64_t, std::int64_t>> bins_;
  std::int64_t total_ = 0;
  std::int64_t overflows_ = 0;
};

std::string load() {
  std::string one, five;
  std::ifstream("/proc/loadavg") >> one >> five;
  return one;
}

/// What the host of this virtual machine has taken from it so far [s], summed over the cores.
double stolen_s() {
  std::ifstream file("/proc/stat");
  std::string label;
  double ticks = 0;  // the eighth number: user, nice, system, idle, iowait, irq, softirq, steal
  file >> label;
  for (int i = 0; i < 8; ++i) file >> ticks;
  return ticks / static_cast<double>(::sysconf(_SC_CLK_TCK));
}

void print(const char* what, const nlohmann::json& durations) {
  std::printf("%-24s %8.0f %8.0f %8.0f %8.0f\n", what, durations["p50"].get<double>(),
              durations["p99"].get<double>(), durations["p999"].get<double>(),
              durations["max"].get<double>());
}

}  // namespace

int main(int argc, char** argv) try {
  const std::string seconds = argc > 1 ? argv[1] : "60";
  const std::string scenario =
      argc > 2 ? argv[2] : TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml";
  const TemporaryDirectory directory;
  const std::string load_before = load();
  const double stolen_before_s = stolen_s();
  Program run("tachless",
              {"run", scenario, "--mode", "realtime", "--duration", seconds, "--isolate", "--quiet",
               "--json", "--out", directory / "run"},
              directory.path());
  // Its histogram reaches to 100 ms.
  Program cyclictest("cyclictest",
                     {"--quiet", "--mlockall", "--priority=80", "--interval=1000",
                      "--duration=" + seconds, "--histogram=100000"},
                     directory.path());
  const std::chrono::seconds limit(std::atoll(seconds.c_str()) + 60);
  const int code = run.wait(limit);
  const std::string load_after = load();
  if (cyclictest.wait(limit) != 0) throw std::runtime_error(cyclictest.errors());
  const double stolen = stolen_s() - stolen_before_s;
  const Histogram beside(cyclictest.output());
  const auto summary = nlohmann::json::parse(run.output());

  std::printf("%-24s %8s %8s %8s %8s   [us]\n", "", "p50", "p99", "p99.9", "max");
  print("command age", summary["command_age_us"]);
  print("wake-up jitter", summary["wake_up_jitter_us"]);
  std::printf("%-24s %8lld %8lld %8lld %8lld   of %lld\n", "cyclictest beside it",
              static_cast<long long>(beside.quantile(0.5)),
              static_cast<long long>(beside.quantile(0.99)),
              static_cast<long long>(beside.quantile(0.999)),
              static_cast<long long>(beside.longest()), static_cast<long long>(beside.total()));
  if (beside.overflows() > 0) {
    std::printf("%24s %lld beyond 100 ms\n", "", static_cast<long long>(beside.overflows()));
  }
  std::printf("missed deadlines %s (longest run %s), missed commands %s (longest run %s)\n",
              summary["missed_deadlines"].dump().c_str(), summary["longest_miss"].dump().c_str(),
              summary["missed_commands"].dump().c_str(),
              summary["longest_command_miss"].dump().c_str());
  std::printf(
      "%s ticks, log gaps %s, exit code %d, %s; load %s before, %s after; "
      "stolen by the host %.2f s\n",
      summary["ticks"].dump().c_str(), summary["log"]["gaps"].dump().c_str(), code,
      summary["fault"].is_null() ? "no protective stop"
                                 : summary["fault"].get<std::string>().c_str(),
      load_before.c_str(), load_after.c_str(), stolen);
  return code;
} catch (const std::exception& error) {
  std::fprintf(stderr, "realtime_bench: %s\n", error.what());
  return 1;
}
