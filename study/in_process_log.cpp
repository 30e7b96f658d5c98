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

/// The messages of a run, one codec and channel for each kind.
class Messages {
 public:
  Messages(const experiment::Scenario& scenario, std::int64_t run, const loop::Layout& layout,
           const std::function<void(const LogMessage&)>& write)
      : prefix_(scenario.robot.channel_prefix),
        layout_(layout),
        num_ticks_(scenario.loop.num_ticks),
        run_(run),
        write_(write) {}

  void write(const TickRecord& record) {
    const loop::Stamp stamp{std::llround(record.time_s * 1e6), run_, record.tick};
    tick_.write(*this, stamp, {.last = record.tick + 1 == num_ticks_});
    std::visit(
        [&]<class M>(const M& measurement) {
          if (!std::holds_alternative<Port<M>>(measurement_)) measurement_.emplace<Port<M>>(*this);
          std::get<Port<M>>(measurement_).write(*this, stamp, measurement);
        },
        record.measurement);
    reference_.write(*this, stamp, record.reference);
    command_.write(*this, stamp, record.command);
    signals_.write(*this, stamp, record.controller);
    truth_.write(*this, stamp, plant::truth_of(record.truth, record.applied));
  }

 private:
  template <class Value>
  struct Port {
    explicit Port(const Messages& all)
        : channel(loop::channel<Value>(all.prefix_)), codec(all.layout_) {}
    void write(const Messages& all, const loop::Stamp& stamp, const Value& value) {
      all.write_({stamp.utime, channel, codec.encode(stamp, value)});
    }
    std::string channel;
    bus::Codec<Value> codec;
  };
  template <class List>
  struct PortOfOne;
  template <class... M>
  struct PortOfOne<loop::TypeList<M...>> {
    using Type = std::variant<std::monostate, Port<M>...>;
  };

  std::string prefix_;
  loop::Layout layout_;
  std::int64_t num_ticks_, run_;
  const std::function<void(const LogMessage&)>& write_;
  Port<loop::Tick> tick_{*this};
  PortOfOne<loop::Measurements>::Type measurement_;
  Port<loop::ReferencePoint> reference_{*this};
  Port<loop::TorqueCommand> command_{*this};
  Port<loop::LawSignals> signals_{*this};
  Port<loop::truth::PlantTruth> truth_{*this};
};

}  // namespace

void log_in_process(const experiment::Scenario& scenario, controller::ScenarioLaw law,
                    std::int64_t run, const std::function<void(const LogMessage&)>& write,
                    const std::function<bool(const TickRecord&)>& on_tick) {
  const loop::Layout layout = controller::law_layout(scenario, law);
  const auto info = plant::run_info(scenario, run, controller::law_info(law));
  write({0, loop::channel<loop::RunInfo>(scenario.robot.channel_prefix), info});
  Messages messages(scenario, run, layout, write);
  run_in_process(scenario, std::move(law), [&](const TickRecord& record) {
    messages.write(record);
    return on_tick(record);
  });
}

}  // namespace tachless::study
