#include "in_process/in_process_log.h"

#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include "messages/measurements.h"
#include "messages/truth/truth_wire.h"
#include "messages/wire.h"
#include "plant/truth_of.h"
#include "session/run_info.h"

namespace tachless::in_process {

void log_in_process(const scenario::Scenario& scenario, controller::ScenarioLaw law,
                    std::int64_t run, const std::function<void(const LogMessage&)>& write,
                    const std::function<bool(const TickRecord&)>& on_tick) {
  const std::string& prefix = scenario.robot.channel_prefix;
  const messages::LawInfo law_info = controller::law_info(*law);
  const messages::Layout layout = controller::law_layout(scenario, *law);
  messages::Port<messages::AnyMeasurement> measurement{
      messages::channel(prefix, law_info.measurement), {law_info.measurement, layout}};
  auto tick = messages::port<messages::Tick>(prefix, layout);
  auto reference = messages::port<messages::ReferencePoint>(prefix, layout);
  auto command = messages::port<messages::TorqueCommand>(prefix, layout);
  auto signals = messages::port<messages::LawSignals>(prefix, layout);
  auto truth = messages::port<messages::truth::PlantTruth>(prefix, layout);
  std::optional<messages::Port<messages::truth::Contact>> contact;
  if (!scenario.plant.mujoco.model.empty()) {
    contact.emplace(messages::port<messages::truth::Contact>(prefix, layout));
  }

  const auto info = session::run_info(scenario, run, law_info);
  write({0, messages::channel<messages::RunInfo>(prefix), info});
  run_in_process(scenario, std::move(law), [&](const TickRecord& record) {
    const messages::Stamp stamp{std::llround(record.time_s * 1e6), run, record.tick};
    const auto put = [&]<class Value>(messages::Port<Value>& port, const Value& value) {
      write({stamp.utime, port.channel, port.codec.encode(stamp, value)});
    };
    put(tick, {.last = record.tick + 1 == scenario.loop.num_ticks});
    put(measurement, record.measurement);
    put(reference, record.reference);
    put(command, record.command);
    put(signals, record.controller);
    put(truth, plant::truth_of(record.truth, record.applied));
    if (contact) put(*contact, plant::contact_of(record.truth));
    return on_tick(record);
  });
}

}  // namespace tachless::in_process
