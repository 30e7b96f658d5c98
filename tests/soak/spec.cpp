#include "tests/soak/spec.h"

#include <fmt/core.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <system_error>

#include "diagnostics/failure.h"
#include "node/options.h"

namespace tachless::soak {
namespace {

namespace fs = std::filesystem;

constexpr double realtime_share = 0.25;  // of the ticks of a lock-step run

std::vector<std::string> overrides(const Setting& setting, const Round& round,
                                   const std::string& scenario_path) {
  std::vector<std::string> all;
  double share = 1;
  if (round.realtime()) {
    all.emplace_back("loop.mode=realtime");
    // A virtual machine can stand still for 100 ms, which is no fault of the loop's; a robot that
    // has held its torque for so long may be too fast after that. Where commands end, the plant has
    // to notice soon enough that the robot is at rest in time.
    const bool commands_end =
        round.fault == Fault::realtime_kill &&
        (round.victim == loop::Role::controller || round.victim == loop::Role::reference);
    all.emplace_back(commands_end ? "loop.max_missed=300" : "loop.max_missed=1000");
    all.emplace_back("loop.max_missed_share=1");
    all.emplace_back("plant.on_limit=warn");
    all.emplace_back("loop.give_up_s=1");
    share = realtime_share;
  } else {
    // On a busy machine hostile datagrams can crowd heartbeats out for long.
    all.emplace_back("loop.give_up_s=60");
  }
  const double period_s = experiment::load_scenario(scenario_path).loop.period_s;
  all.push_back(fmt::format("loop.duration_s={:f}",
                            share * static_cast<double>(setting.num_ticks) * period_s));
  return all;
}

fs::path write_key(const fs::path& directory, std::uint64_t seed) {
  const fs::path path = directory / "soak.key";
  std::ofstream(path) << fmt::format("{:a>64}", seed);
  chmod(path.c_str(), 0600);
  return path;
}

}  // namespace

void make_directory(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error || access(path.c_str(), W_OK | X_OK) != 0) {
    throw diagnostics::Failure(
        diagnostics::ExitCode::bad_usage,
        fmt::format("--out {}: cannot be written to; choose another directory", path.string()));
  }
}

Spec specify(const Setting& setting, const Round& round, const fs::path& out) {
  const std::string scenario_path = setting.scenarios / (round.scenario + ".yaml");
  const std::vector<std::string> values = overrides(setting, round, scenario_path);
  fs::remove_all(out);
  make_directory(out);
  std::vector<std::string> command = {setting.program, "run",
                                      scenario_path,   "--quiet",
                                      "--out",         out,
                                      "--lcm-url",     node::default_lcm_url,
                                      "--run-id",      fmt::format("{}", run_id)};
  for (const std::string& value : values) command.insert(command.end(), {"--set", value});
  if (round.fault == Fault::key) {
    command.insert(command.end(), {"--key-file", write_key(out, round.seed)});
  }
  if (round.fault == Fault::restart) command.insert(command.end(), {"--restart", "controller"});
  return {round,   setting.program,        out, experiment::load_scenario(scenario_path, values),
          command, setting.most_growth_kib};
}

}  // namespace tachless::soak
