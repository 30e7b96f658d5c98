// Two loggers under pressure in the same minute: `tachless-logger` and the stock `lcm-logger` hear
// the same realtime run on one bus, in a network of their own, while more processes than there are
// cores do nothing but compute. First all six channels of the run at 1 kHz, then bursts of a
// thousand messages, one right after the other.
//   logger_bench [SECONDS [RECEIVE_BUFFER_BYTES]]

#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <thread>
#include <vector>

#include "experiment/scenario.h"
#include "logger/log_file.h"
#include "node/options.h"
#include "process/this_process.h"
#include "tests/support/program.h"
#include "tests/system/everyone_else.h"

using namespace tachless;

namespace {

using namespace std::chrono_literals;
using system_test::EveryoneElse;

constexpr std::int64_t bursts = 10;
constexpr std::int64_t ticks_in_burst = 167;  // six messages each: 1002

/// Processes that compute and nothing else, ended with the object.
class BusyMachine {
 public:
  BusyMachine() {
    for (unsigned i = 0; i < 2 * std::thread::hardware_concurrency(); ++i) {
      const pid_t child = fork();
      if (child == 0) {
        static volatile bool computing = true;
        while (computing) {
        }
      }
      if (child > 0) children_.push_back(child);
    }
  }
  BusyMachine(const BusyMachine&) = delete;
  BusyMachine& operator=(const BusyMachine&) = delete;
  ~BusyMachine() {
    for (const pid_t child : children_) kill(child, SIGKILL);
    for (const pid_t child : children_) waitpid(child, nullptr, 0);
  }

 private:
  std::vector<pid_t> children_;
};

struct Count {
  std::int64_t steady = 0, in_bursts = 0;
};

/// Messages of the run in a log, by the phase that their tick belongs to.
Count recorded(const std::string& path, const std::string& prefix, std::int64_t steady_ticks) {
  logger::LogReader log(path);
  Count count;
  while (const auto event = log.next()) {
    if (!event->channel.starts_with(prefix + "_") || event->channel.ends_with("_PARTICIPANT")) {
      continue;
    }
    const std::int64_t tick = bus::stamp_of(event->data).tick;
    if (tick < 0) continue;  // RUN_INFO
    ++(tick < steady_ticks ? count.steady : count.in_bursts);
  }
  return count;
}

void print(const char* what, const Count& sent, const Count& of) {
  const auto lost = [](std::int64_t all, std::int64_t got) {
    return 100 * static_cast<double>(all - got) / static_cast<double>(all);
  };
  std::printf("%-18s %9lld of %lld (%.2f %% lost) %9lld of %lld (%.2f %% lost)\n", what,
              static_cast<long long>(of.steady), static_cast<long long>(sent.steady),
              lost(sent.steady, of.steady), static_cast<long long>(of.in_bursts),
              static_cast<long long>(sent.in_bursts), lost(sent.in_bursts, of.in_bursts));
}

void sleep_until(std::chrono::steady_clock::time_point deadline) {
  const auto since = deadline.time_since_epoch();
  const timespec time{since / 1s, (since % 1s) / 1ns};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, nullptr);
}

}  // namespace

int main(int argc, char** argv) try {
  const std::int64_t seconds = argc > 1 ? std::atoll(argv[1]) : 60;
  const std::string url = std::string(node::default_lcm_url) +
                          (argc > 2 ? std::string("&recv_buf_size=") + argv[2] : "");
  process::enter_private_network();
  const std::int64_t steady_ticks = 1000 * seconds;
  const std::int64_t ticks = steady_ticks + bursts * ticks_in_burst;
  const std::vector<std::string> overrides = {
      "loop.mode=realtime", "loop.duration_s=" + std::to_string(1e-3 * static_cast<double>(ticks))};
  const std::string path = TACHLESS_SOURCE_DIR "/scenarios/practical_rigid.yaml";
  const experiment::Scenario scenario = experiment::load_scenario(path, overrides);

  const TemporaryDirectory directory;
  Program stock("lcm-logger", {"-q", "--lcm-url=" + url, directory / "stock"}, directory.path());
  Program ours("tachless-logger",
               {path, "--set", overrides[0], "--set", overrides[1], "--lcm-url", url, "--out-log",
                directory / "ours"},
               directory.path());
  EveryoneElse others(scenario, url);
  others.meet_the_logger();
  std::this_thread::sleep_for(1s);  // lcm-logger does not say when it is ready
  {
    const BusyMachine busy;
    const auto start = std::chrono::steady_clock::now();
    for (std::int64_t k = 0; k < ticks;) {
      sleep_until(start + k * 1ms);
      if (k % 100 == 0 || k >= steady_ticks) others.announce(loop::ParticipantState::running);
      const std::int64_t end = k < steady_ticks ? k + 1 : k + ticks_in_burst;
      while (k < end) others.say(k++);
    }
    others.announce(loop::ParticipantState::finished);
    if (ours.wait() != 0) throw std::runtime_error(ours.errors());
    stock.signal(SIGINT);
    stock.wait();
  }
  const Count sent{EveryoneElse::messages_per_tick * steady_ticks,
                   EveryoneElse::messages_per_tick * bursts * ticks_in_burst};
  std::printf("%-18s %lld s of 6 channels at 1 kHz, %lld bursts of %lld messages\n", url.c_str(),
              static_cast<long long>(seconds), static_cast<long long>(bursts),
              static_cast<long long>(EveryoneElse::messages_per_tick * ticks_in_burst));
  const std::string& prefix = scenario.robot.channel_prefix;
  print("tachless-logger", sent, recorded(directory / "ours", prefix, steady_ticks));
  print("lcm-logger", sent, recorded(directory / "stock", prefix, steady_ticks));
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
