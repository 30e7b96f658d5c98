#include "tests/campaign/programs.h"

#include <fmt/core.h>
#include <sys/stat.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <fstream>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "base/logging.h"
#include "bus/udp_transport.h"
#include "session/options.h"
#include "tests/campaign/attacker.h"
#include "tests/campaign/impostor.h"
#include "tests/support/packet_loss.h"
#include "tests/support/program.h"

namespace tachless::campaign {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using base::Clock;
using base::ExitCode;
using messages::Role;
using system_test::all_roles;

constexpr auto hung_after = 30s;

/// Returns the printed causes of the program's end, one per line, without mark and name.
std::string causes_in(const std::string& output) {
  std::istringstream lines(output);
  std::string causes;
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with(base::error_mark)) continue;
    const auto name = line.find(": ");
    causes += (causes.empty() ? "" : "\n") +
              line.substr(name == std::string::npos ? base::error_mark.size() : name + 2);
  }
  return causes;
}

/// The four programs of a round, with the round's mishap.
class Programs {
 public:
  Programs(const Plan& plan, const fs::path& directory) : plan_(plan), directory_(directory) {
    for (const Role role : all_roles) start(role);
  }

  [[nodiscard]] fs::path log_path() const { return directory_ / "lcmlog"; }

  /// @param received number of datagrams that have been on the bus
  void on_received(std::size_t received) {
    if (!plan_.mishap || happened_ || received <= static_cast<std::size_t>(plan_.mishap->at))
      return;
    happened_ = true;
    const Program& victim = *programs_.at(plan_.mishap->role);
    switch (plan_.mishap->kind) {
      case Mishap::Kind::kill:
        return victim.signal(SIGKILL);
      case Mishap::Kind::interrupt:
        return victim.signal(SIGINT);
      case Mishap::Kind::fail:  // not on the real bus
        return;
      case Mishap::Kind::stop:
        victim.signal(SIGSTOP);
        resumed_ = std::async(std::launch::async, [&victim, ms = plan_.mishap->stop_ms] {
          std::this_thread::sleep_for(std::chrono::milliseconds(ms));
          victim.signal(SIGCONT);
        });
    }
  }

  /// Waits for all programs and interrupts a run that does not end.
  void wait(Evidence& into) {
    if (!all_ended()) {
      into.hung = true;
      for (const auto& [role, program] : programs_) program->signal(SIGINT);
      if (!all_ended()) throw std::runtime_error("a program cannot be interrupted");
    }
    for (const auto& [role, program] : programs_) {
      auto& outcome = into.result.of[role];
      outcome.code = static_cast<ExitCode>(program->wait());
      outcome.fault = causes_in(program->errors());
      std::ifstream file(statistics_path(role));
      try {
        outcome.statistics =
            session::statistics_from_json({std::istreambuf_iterator<char>(file), {}});
      } catch (const std::invalid_argument&) {  // killed, or refused its command line
        // A process that does not yet catch signals ends by them without a message.
        if (outcome.code == ExitCode::interrupted && outcome.fault.empty()) {
          outcome.fault = "interrupted before it was up";
        }
      }
    }
  }
  /// Returns whether the mishap has happened; call it after the attacker has stopped.
  [[nodiscard]] bool happened() const { return happened_; }

 private:
  [[nodiscard]] fs::path statistics_path(Role role) const {
    return directory_ / fmt::format("{}.json", messages::name(role));
  }

  void start(Role role) {
    const Experiment what = experiment_of(plan_.pace);
    std::vector<std::string> arguments = {
        fmt::format(TACHLESS_SOURCE_DIR "/scenarios/{}.yaml", what.name),
        "--quiet",
        "--mark-levels",
        "--lcm-url",
        session::default_lcm_url,
        "--wait-s",
        fmt::format("{}", wait_s),
        "--stats",
        statistics_path(role)};
    for (const std::string& value : what.overrides) {
      arguments.insert(arguments.end(), {"--set", value});
    }
    if (plan_.keyed) arguments.insert(arguments.end(), {"--key-file", directory_ / "key"});
    if (role == Role::plant) {
      arguments.insert(arguments.end(), {"--run-id", "7"});
    }
    if (role == Role::logger) arguments.insert(arguments.end(), {"--out-log", log_path()});
    programs_[role] = std::make_unique<Program>(session::program_name(role), arguments, directory_);
  }

  bool all_ended() {
    const auto until = Clock::now() + hung_after;
    for (const auto& [role, program] : programs_) {
      while (program->running()) {
        if (Clock::now() > until) return false;
        std::this_thread::sleep_for(5ms);
      }
    }
    return true;
  }

  const Plan& plan_;
  fs::path directory_;
  std::map<Role, std::unique_ptr<Program>> programs_;
  bool happened_ = false;
  std::future<void> resumed_;
};

void write_key(const fs::path& path) {
  const bus::Key key = campaign::key();
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(key.bytes().data()),
             static_cast<std::streamsize>(key.bytes().size()));
  chmod(path.c_str(), 0600);
}

}  // namespace

Plan on_the_real_bus(Plan plan) {
  plan.network = {.loss = plan.network.loss, .seed = plan.seed};
  if (plan.mishap && plan.mishap->kind == Mishap::Kind::fail) {
    plan.mishap->kind = Mishap::Kind::interrupt;
  }
  if (plan.hostility) plan.hostility->races = plan.hostility->drops = 0;
  return plan;
}

Evidence play_with_programs(const Plan& plan, const fs::path& directory) {
  Evidence evidence = expected(plan);
  const auto& recording = recording_for(plan);
  fs::remove_all(directory);
  fs::create_directories(directory);
  if (plan.keyed) write_key(directory / "key");
  std::optional<support::PacketLoss> loss;
  if (plan.network.loss > 0) loss.emplace(static_cast<int>(std::lround(100 * plan.network.loss)));
  Lies lies;
  const auto start = Clock::now();
  Programs programs(plan, directory);
  Attacker attacker(std::make_unique<Impostor>(plan.hostility ? plan.hostility->sender : ""),
                    plan.hostility, plan.seed, recording, lies,
                    [&](std::size_t received) { programs.on_received(received); });
  programs.wait(evidence);
  evidence.wall_s = std::chrono::duration<double>(Clock::now() - start).count();
  attacker.stop();
  evidence.num_hostile = plan.hostility ? attacker.num_sent() : 0;
  evidence.lies = lies.ticks();
  evidence.mishap_happened = programs.happened();
  read_log(programs.log_path(), evidence);
  return evidence;
}

}  // namespace tachless::campaign
