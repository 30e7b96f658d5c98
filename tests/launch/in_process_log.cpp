#include "tests/launch/in_process_log.h"

#include <cmath>

#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "controller/catalogue.h"
#include "study/in_process_loop.h"

namespace launch {

std::vector<logger::Recorded> in_process_log(const app::Scenario& scenario, std::int64_t run) {
  const int n = scenario.num_joints;
  const bus::Layout layout{n, scenario.robot.flexible ? n : 0,
                           controller::num_filters(scenario.controller.law)};
  const std::string& prefix = scenario.robot.channel_prefix;
  std::vector<logger::Recorded> messages;
  const auto add = [&](const std::string& channel, const bus::Stamp& stamp, const auto& value) {
    bus::Codec<std::decay_t<decltype(value)>> codec(layout);
    const auto bytes = codec.encode(stamp, value);
    messages.push_back(
        {stamp.utime, channel, {reinterpret_cast<const char*>(bytes.data()), bytes.size()}});
  };
  const bus::RunInfo info = {scenario.loop.num_ticks,
                             scenario.loop.period_s,
                             "0.1.0",
                             prefix,
                             std::string(controller::measurement_suffix(scenario.controller.law)),
                             scenario.text,
                             scenario.robot.urdf_text};
  add(prefix + "_RUN_INFO", {0, run, -1}, info);
  study::run_in_process(scenario, [&](const study::TickRecord& record) {
    const bus::Stamp stamp{std::llround(record.time_s * 1e6), run, record.tick};
    const bool last = record.tick + 1 == scenario.loop.num_ticks;
    add(bus::channel<bus::Tick>(prefix), stamp, bus::Tick{last});
    std::visit(
        [&](const auto& measurement) {
          add(bus::channel<std::decay_t<decltype(measurement)>>(prefix), stamp, measurement);
        },
        record.measurement);
    add(bus::channel<robot::ReferencePoint>(prefix), stamp, record.reference);
    add(bus::channel<robot::TorqueCommand>(prefix), stamp, record.command);
    add(bus::channel<robot::ControllerState>(prefix), stamp, record.controller);
    bus::truth::PlantTruth truth;
    truth.q = record.truth.q;
    truth.v = record.truth.v;
    truth.theta = record.truth.theta;
    truth.thetadot = record.truth.thetadot;
    truth.tau = record.applied.tau;
    truth.saturated = record.applied.saturated;
    add(bus::channel<bus::truth::PlantTruth>(prefix), stamp, truth);
    return true;
  });
  return messages;
}

app::Scenario shortened(const std::string& file, const std::string& duration_s,
                        std::vector<std::string> overrides) {
  overrides.push_back("loop.duration_s=" + duration_s);
  return app::load_scenario(std::string(TACHLESS_SOURCE_DIR "/scenarios/") + file, overrides);
}

}  // namespace launch
