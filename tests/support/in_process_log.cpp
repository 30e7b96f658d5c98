#include "tests/support/in_process_log.h"

#include <cmath>

#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "controller/registry.h"
#include "study/in_process_loop.h"

namespace tachless::support {

std::vector<logger::Recorded> in_process_log(const experiment::Scenario& scenario,
                                             std::int64_t run) {
  const int n = scenario.num_joints;
  const auto signals = controller::law_facts(scenario.controller.law).signals;
  const auto layout =
      loop::layout(n, scenario.robot.flexible.has_value(), static_cast<int>(signals.size()));
  const std::string& prefix = scenario.robot.channel_prefix;
  std::vector<logger::Recorded> messages;
  const auto add = [&](const std::string& channel, const loop::Stamp& stamp, const auto& value) {
    bus::Codec<std::decay_t<decltype(value)>> codec(layout);
    const auto bytes = codec.encode(stamp, value);
    messages.push_back(
        {stamp.utime, channel, {reinterpret_cast<const char*>(bytes.data()), bytes.size()}});
  };
  const loop::RunInfo info = {scenario.loop.num_ticks,
                              scenario.loop.period_s,
                              "0.2.0",
                              prefix,
                              std::string(controller::measurement_suffix(scenario.controller.law)),
                              loop::text_of(signals),
                              scenario.text,
                              scenario.robot.urdf_text};
  add(prefix + "_RUN_INFO", {0, run, -1}, info);
  study::run_in_process(scenario, [&](const study::TickRecord& record) {
    const loop::Stamp stamp{std::llround(record.time_s * 1e6), run, record.tick};
    const bool last = record.tick + 1 == scenario.loop.num_ticks;
    add(loop::channel<loop::Tick>(prefix), stamp, loop::Tick{last});
    std::visit(
        [&](const auto& measurement) {
          add(loop::channel<std::decay_t<decltype(measurement)>>(prefix), stamp, measurement);
        },
        record.measurement);
    add(loop::channel<loop::ReferencePoint>(prefix), stamp, record.reference);
    add(loop::channel<loop::TorqueCommand>(prefix), stamp, record.command);
    add(loop::channel<loop::LawSignals>(prefix), stamp, record.controller);
    loop::truth::PlantTruth truth;
    truth.q = record.truth.q;
    truth.v = record.truth.v;
    truth.theta = record.truth.theta;
    truth.thetadot = record.truth.thetadot;
    truth.tau = record.applied.tau;
    truth.saturated = record.applied.saturated;
    add(loop::channel<loop::truth::PlantTruth>(prefix), stamp, truth);
    return true;
  });
  return messages;
}

experiment::Scenario shortened(const std::string& file, const std::string& duration_s,
                               std::vector<std::string> overrides) {
  overrides.push_back("loop.duration_s=" + duration_s);
  return experiment::load_scenario(std::string(TACHLESS_SOURCE_DIR "/scenarios/") + file,
                                   overrides);
}

}  // namespace tachless::support
