#include "study/in_process_log.h"

#include <cmath>
#include <string>
#include <utility>
#include <variant>

#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "loop/measurements.h"
#include "plant/run_messages.h"

namespace tachless::study {
namespace {

/// The messages of one kind.
template <class Value>
struct Port {
  std::string channel;
  bus::Codec<Value> codec;
  const std::function<void(const LogMessage&)>& to;

  Port(const std::string& prefix, const loop::Layout& layout,
       const std::function<void(const LogMessage&)>& write)
      : channel(loop::channel<Value>(prefix)), codec(layout), to(write) {}

  void write(const loop::Stamp& stamp, const Value& value) {
    to({stamp.utime, channel, codec.encode(stamp, value)});
  }
};

}  // namespace

void log_in_process(const experiment::Scenario& scenario, controller::ScenarioLaw law,
                    std::int64_t run, const std::function<void(const LogMessage&)>& write,
                    const std::function<bool(const TickRecord&)>& on_tick) {
  const std::string& prefix = scenario.robot.channel_prefix;
  const loop::Layout layout = controller::law_layout(scenario, law);
  const auto info = plant::run_info(scenario, run, controller::law_info(law));
  write({0, loop::channel<loop::RunInfo>(prefix), info});
  const auto log_run = [&]<class Measurement>(controller::AnyLawOf<Measurement> own) {
    Port<loop::Tick> ticks(prefix, layout, write);
    Port<Measurement> measurements(prefix, layout, write);
    Port<loop::ReferencePoint> references(prefix, layout, write);
    Port<loop::TorqueCommand> commands(prefix, layout, write);
    Port<loop::LawSignals> signals(prefix, layout, write);
    Port<loop::truth::PlantTruth> truths(prefix, layout, write);
    run_in_process(scenario, std::move(own), [&](const TickRecord& record) {
      const loop::Stamp stamp{std::llround(record.time_s * 1e6), run, record.tick};
      ticks.write(stamp, {.last = record.tick + 1 == scenario.loop.num_ticks});
      measurements.write(stamp, std::get<Measurement>(record.measurement));
      references.write(stamp, record.reference);
      commands.write(stamp, record.command);
      signals.write(stamp, record.controller);
      truths.write(stamp, plant::truth_of(record.truth, record.applied));
      return on_tick(record);
    });
  };
  std::visit(log_run, std::move(law));
}

}  // namespace tachless::study
