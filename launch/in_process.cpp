#include "launch/in_process.h"

#include <unistd.h>

#include <chrono>
#include <cmath>

#include "bus/wire.h"
#include "logger/log_file.h"
#include "process/interruption.h"
#include "study/in_process_log.h"

namespace tachless::launch {
namespace {

using diagnostics::ExitCode;
using diagnostics::Failure;
using Clock = std::chrono::steady_clock;

/// What a plant process counts.
class Counters {
 public:
  Counters(std::int64_t run, int num_joints) {
    statistics_.run_id = run;
    statistics_.plant().saturated_ticks.assign(static_cast<std::size_t>(num_joints), 0);
    statistics_.plant().beyond_limit_ticks.assign(static_cast<std::size_t>(num_joints), 0);
  }
  void add(const study::TickRecord& record) {
    statistics_.ticks = record.tick + 1;
    node::PlantStatistics& plant = statistics_.plant();
    for (std::size_t i = 0; i < plant.saturated_ticks.size(); ++i) {
      plant.saturated_ticks[i] += record.applied.saturated[i] ? 1 : 0;
      plant.beyond_limit_ticks[i] += record.beyond_limit[i] ? 1 : 0;
    }
  }
  node::Statistics take(const RunEnd& end) {
    statistics_.exit_code = end.code;
    statistics_.fault = end.fault;
    statistics_.wall_s = end.wall_s;
    return statistics_;
  }
  [[nodiscard]] std::int64_t ticks() const { return statistics_.ticks; }

 private:
  node::Statistics statistics_;
};

void append_fault(logger::LogWriter& log, const experiment::Scenario& scenario, std::int64_t run,
                  std::int64_t ticks, const Failure& failure) {
  loop::Participant plant;
  plant.instance = 1;
  plant.scenario_digest = scenario.digest;
  plant.pid = getpid();
  plant.state = loop::ParticipantState::fault;
  plant.fault_code = static_cast<int>(failure.code());
  plant.scenario = scenario.name.substr(0, loop::max_participant_text);
  plant.fault = std::string(failure.what()).substr(0, loop::max_participant_text);
  const double time_s = static_cast<double>(ticks) * scenario.loop.period_s;
  const loop::Stamp stamp{std::llround(time_s * 1e6), run, ticks - 1};
  bus::Codec<loop::Participant> codec(loop::Layout{});
  log.append(stamp.utime, loop::channel<loop::Participant>(scenario.robot.channel_prefix),
             codec.encode(stamp, plant));
}

}  // namespace

RunEnd run_in_this_process(const experiment::Scenario& scenario, const RunOptions& options,
                           const std::filesystem::path& path, Screen& screen) {
  constexpr std::int64_t looks = 64;  // ticks from one look at clock and user to the next
  const std::atomic<bool>& interrupted = process::catch_interruptions();
  const std::int64_t run = options.run_id;
  Progress progress(scenario.loop.num_ticks, scenario.loop.period_s, options.robot);
  Counters counters(run, scenario.num_joints);
  const Clock::time_point begun = Clock::now();
  RunEnd end;
  logger::LogWriter log(path);
  try {
    study::log_in_process(
        scenario, options.make_law()(scenario), run,
        [&](const study::LogMessage& message) {
          log.append(message.utime, message.channel, message.data);
        },
        [&](const study::TickRecord& record) {
          counters.add(record);
          if (record.tick % looks != 0) return true;
          progress.note(record.tick, (record.truth.q - record.reference.q_ref).norm(),
                        Clock::now());
          screen.show({&progress, 1});
          return !interrupted;
        });
    log.close();
    if (interrupted) end = {ExitCode::interrupted, "interrupted", 0, {}, {}};
  } catch (const Failure& failure) {
    end = {failure.code(), failure.what(), 0, {}, {}};
    if (log.num_events() > 0 && failure.code() == ExitCode::protective_stop) {
      append_fault(log, scenario, run, counters.ticks(), failure);
    }
  }
  end.placement = "one process";
  end.wall_s = std::chrono::duration<double>(Clock::now() - begun).count();
  end.statistics.push_back(counters.take(end));
  return end;
}

}  // namespace tachless::launch
