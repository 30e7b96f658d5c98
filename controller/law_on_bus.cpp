#include "controller/law_on_bus.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>
#include <variant>
#include <vector>

#include "bus/wire.h"
#include "controller/law_stepper.h"
#include "diagnostics/logging.h"
#include "protocol/lockstep/message_ring.h"

namespace tachless::controller {
namespace {

/// The decoded values of the last ticks, each at the place of its tick. Preallocated.
template <class Value>
class DecodedRing {
 public:
  struct Entry {
    loop::Stamp stamp{.tick = -1};
    Value value;
  };

  void put(const loop::Stamp& stamp, const Value& value) { slot(stamp.tick) = {stamp, value}; }

  /// @throw std::logic_error when that tick's was not put, or a later one took its place.
  [[nodiscard]] const Entry& at(std::int64_t tick) {
    const Entry& entry = slot(tick);
    if (entry.stamp.tick != tick) {
      throw std::logic_error(fmt::format("no decoded input of tick {} is kept", tick));
    }
    return entry;
  }

 private:
  static constexpr std::int64_t depth = protocol::lockstep::MessageRing::depth;
  Entry& slot(std::int64_t tick) { return entries_[static_cast<std::size_t>(tick % depth)]; }

  std::vector<Entry> entries_ = std::vector<Entry>(static_cast<std::size_t>(depth));
};

/// What one step gave; valid until the next one.
struct Advance {
  const loop::TorqueCommand& command;
  const loop::LawSignals& signals;
  std::int64_t skipped = 0;
  bool restarted = false;
};

}  // namespace

/// Codecs and values of the messages that do not depend on the law's measurement type.
struct LawOnBus::Messages {
  explicit Messages(const loop::Layout& layout)
      : reference_codec(layout), command_codec(layout), state_codec(layout) {}

  bus::Codec<loop::ReferencePoint> reference_codec;
  bus::Codec<loop::TorqueCommand> command_codec;
  bus::Codec<loop::LawSignals> state_codec;
  loop::ReferencePoint newest;
  DecodedRing<loop::ReferencePoint> references;
};

class LawOnBus::Measured {
 public:
  virtual ~Measured() = default;
  [[nodiscard]] virtual std::size_t longest() const = 0;
  virtual bool accept(node::Session& session, const bus::Datagram& datagram,
                      loop::Stamp& stamp) = 0;
  virtual bool decode(std::span<const std::byte> bytes, loop::Stamp& stamp) = 0;
  virtual void keep(const loop::Stamp& stamp) = 0;
  [[nodiscard]] virtual std::int64_t utime(std::int64_t tick) = 0;
  /// Steps the law over `tick` and keeps its memory.
  /// @throw diagnostics::Failure(protective_stop) when the result is not finite.
  virtual Advance step(std::int64_t tick, const loop::ReferencePoint& reference) = 0;
};

template <class Measurement>
class LawOnBus::MeasuredBy final : public LawOnBus::Measured {
 public:
  MeasuredBy(std::unique_ptr<AnyLaw<Measurement>> law, const experiment::LoopSpec& loop,
             const loop::Layout& layout)
      : stepper_(std::move(law), loop), codec_(layout) {}

  [[nodiscard]] std::size_t longest() const override { return codec_.longest(); }
  bool accept(node::Session& session, const bus::Datagram& datagram, loop::Stamp& stamp) override {
    return session.accept(codec_, datagram, stamp, newest_);
  }
  bool decode(std::span<const std::byte> bytes, loop::Stamp& stamp) override {
    return codec_.decode(bytes, stamp, newest_) == bus::Rejection::none;
  }
  void keep(const loop::Stamp& stamp) override { measurements_.put(stamp, newest_); }
  [[nodiscard]] std::int64_t utime(std::int64_t tick) override {
    return measurements_.at(tick).stamp.utime;
  }
  Advance step(std::int64_t tick, const loop::ReferencePoint& reference) override {
    const auto outcome = stepper_.step(tick, measurements_.at(tick).value, reference);
    const auto& [command, signals] = outcome.output;
    if (!bus::all_finite(command) || !bus::all_finite(signals)) {
      throw not_finite(stepper_.law().name(), command.tau, tick);
    }
    stepper_.keep(tick);
    return {command, signals, outcome.skipped, outcome.restarted};
  }

 private:
  LawStepper<Measurement> stepper_;
  bus::Codec<Measurement> codec_;
  Measurement newest_;  ///< decoded last
  DecodedRing<Measurement> measurements_;
};

LawOnBus::LawOnBus(const experiment::Scenario& scenario, ScenarioLaw law, bus::Transport& transport,
                   node::Session& session)
    : transport_(transport),
      session_(session),
      info_(law_info(law)),
      measurement_channel_(fmt::format("{}_{}", scenario.robot.channel_prefix, info_.measurement)),
      reference_channel_(loop::channel<loop::ReferencePoint>(scenario.robot.channel_prefix)),
      command_channel_(loop::channel<loop::TorqueCommand>(scenario.robot.channel_prefix)),
      state_channel_(loop::channel<loop::LawSignals>(scenario.robot.channel_prefix)) {
  const loop::Layout layout = law_layout(scenario, law);
  messages_ = std::make_unique<Messages>(layout);
  measured_ = std::visit(
      [&]<class Measurement>(
          std::unique_ptr<AnyLaw<Measurement>> own) -> std::unique_ptr<Measured> {
        return std::make_unique<MeasuredBy<Measurement>>(std::move(own), scenario.loop, layout);
      },
      std::move(law));
  diagnostics::log_detail("law {}, measures {}, publishes its signals {}", info_.name,
                          info_.measurement, info_.signals);
}

LawOnBus::~LawOnBus() = default;

std::size_t LawOnBus::longest_measurement() const { return measured_->longest(); }
std::size_t LawOnBus::longest_reference() const { return messages_->reference_codec.longest(); }
std::size_t LawOnBus::longest_command() const { return messages_->command_codec.longest(); }
std::size_t LawOnBus::longest_state() const { return messages_->state_codec.longest(); }

bool LawOnBus::accept_measurement(const bus::Datagram& datagram, loop::Stamp& stamp) {
  return measured_->accept(session_, datagram, stamp);
}

bool LawOnBus::accept_reference(const bus::Datagram& datagram, loop::Stamp& stamp) {
  return session_.accept(messages_->reference_codec, datagram, stamp, messages_->newest);
}

void LawOnBus::keep_measurement(const loop::Stamp& stamp) { measured_->keep(stamp); }

void LawOnBus::keep_reference(const loop::Stamp& stamp) {
  messages_->references.put(stamp, messages_->newest);
}

LawOnBus::Result LawOnBus::step(std::int64_t tick) {
  const auto begin = loop::Clock::now();
  const loop::Stamp stamp{measured_->utime(tick), session_.run(), tick};
  const Advance advance = measured_->step(tick, messages_->references.at(tick).value);
  const auto command = messages_->command_codec.encode(stamp, advance.command);
  transport_.publish(command_channel_, command);
  const auto state = messages_->state_codec.encode(stamp, advance.signals);
  transport_.publish(state_channel_, state);

  // stableNorm: the squares of a finite error may overflow. So may its norm, of several joints.
  const double error_norm = advance.signals.num > 0 ? advance.signals.value[0].stableNorm() : 0;
  session_.progressed(tick, std::min(error_norm, std::numeric_limits<double>::max()));
  session_.statistics().ticks = tick + 1;
  session_.statistics().work_us.add(loop::Clock::now() - begin);
  return {command, state, advance.skipped, advance.restarted};
}

bool LawOnBus::rebuild(std::int64_t tick, std::span<const std::byte> measurement,
                       std::span<const std::byte> reference) {
  loop::Stamp stamp;
  if (!measured_->decode(measurement, stamp) ||
      messages_->reference_codec.decode(reference, stamp, messages_->newest) !=
          bus::Rejection::none) {
    return false;
  }
  measured_->keep(stamp);
  measured_->step(tick, messages_->newest);
  session_.progressed(tick);
  session_.statistics().ticks = tick + 1;
  return true;
}

}  // namespace tachless::controller
