#include "study/in_process_log.h"

#include <cmath>
#include <string>
#include <utility>

#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "loop/measurements.h"
#include "node/run_info.h"
#include "plant/run_messages.h"

namespace tachless::study {

void log_in_process(const experiment::Scenario& scenario, controller::ScenarioLaw law,
                    std::int64_t run, const std::function<void(const LogMessage&)>& write,
                    const std::function<bool(const TickRecord&)>& on_tick) {
  const std::string& prefix = scenario.robot.channel_prefix;
  const loop::LawInfo law_info = controller::law_info(*law);
  const loop::Layout layout = controller::law_layout(scenario, *law);
  bus::Port<loop::AnyMeasurement> measurement{loop::channel(prefix, law_info.measurement),
                                              {law_info.measurement, layout}};
  auto tick = bus::port<loop::Tick>(prefix, layout);
  auto reference = bus::port<loop::ReferencePoint>(prefix, layout);
  auto command = bus::port<loop::TorqueCommand>(prefix, layout);
  auto signals = bus::port<loop::LawSignals>(prefix, layout);
  auto truth = bus::port<loop::truth::PlantTruth>(prefix, layout);

  const auto info = node::run_info(scenario, run, law_info);
  write({0, loop::channel<loop::RunInfo>(prefix), info});
  run_in_process(scenario, std::move(law), [&](const TickRecord& record) {
    const loop::Stamp stamp{std::llround(record.time_s * 1e6), run, record.tick};
    const auto put = [&]<class Value>(bus::Port<Value>& port, const Value& value) {
      write({stamp.utime, port.channel, port.codec.encode(stamp, value)});
    };
    put(tick, {.last = record.tick + 1 == scenario.loop.num_ticks});
    put(measurement, record.measurement);
    put(reference, record.reference);
    put(command, record.command);
    put(signals, record.controller);
    put(truth, plant::truth_of(record.truth, record.applied));
    return on_tick(record);
  });
}

}  // namespace tachless::study
