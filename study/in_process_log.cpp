#include "study/in_process_log.h"

#include <cmath>
#include <string>
#include <tuple>
#include <utility>
#include <variant>

#include "bus/truth/truth_wire.h"
#include "bus/wire.h"
#include "loop/measurements.h"
#include "plant/run_messages.h"

namespace tachless::study {
namespace {

/// The messages of a run, one codec and channel for each kind.
template <class... Value>
class Messages {
 public:
  Messages(const std::string& prefix, const loop::Layout& layout,
           const std::function<void(const LogMessage&)>& write)
      : ports_{bus::port<Value>(prefix, layout)...}, write_(write) {}

  template <class One>
  void write(const loop::Stamp& stamp, const One& value) {
    auto& port = std::get<bus::Port<One>>(ports_);
    write_({stamp.utime, port.channel, port.codec.encode(stamp, value)});
  }

 private:
  std::tuple<bus::Port<Value>...> ports_;
  const std::function<void(const LogMessage&)>& write_;
};

template <class Measurements>
struct OfLoop;
template <class... M>
struct OfLoop<loop::TypeList<M...>> {
  using Messages = study::Messages<loop::Tick, M..., loop::ReferencePoint, loop::TorqueCommand,
                                   loop::LawSignals, loop::truth::PlantTruth>;
};

}  // namespace

void log_in_process(const experiment::Scenario& scenario, controller::ScenarioLaw law,
                    std::int64_t run, const std::function<void(const LogMessage&)>& write,
                    const std::function<bool(const TickRecord&)>& on_tick) {
  const std::string& prefix = scenario.robot.channel_prefix;
  OfLoop<loop::Measurements>::Messages messages(prefix, controller::law_layout(scenario, *law),
                                                write);
  const auto info = plant::run_info(scenario, run, controller::law_info(*law));
  write({0, loop::channel<loop::RunInfo>(prefix), info});
  run_in_process(scenario, std::move(law), [&](const TickRecord& record) {
    const loop::Stamp stamp{std::llround(record.time_s * 1e6), run, record.tick};
    messages.write(stamp, loop::Tick{.last = record.tick + 1 == scenario.loop.num_ticks});
    std::visit([&](const auto& measurement) { messages.write(stamp, measurement); },
               record.measurement);
    messages.write(stamp, record.reference);
    messages.write(stamp, record.command);
    messages.write(stamp, record.controller);
    messages.write(stamp, plant::truth_of(record.truth, record.applied));
    return on_tick(record);
  });
}

}  // namespace tachless::study
