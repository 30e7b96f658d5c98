#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "bus/transport.h"
#include "controller/registry.h"
#include "experiment/scenario.h"
#include "loop/messages.h"
#include "node/session.h"

namespace tachless::controller {

/// A law as the bus sees it: the channels and codecs that belong to it (what it
/// measures is what its type says, so is the channel), and one tick from decoded inputs to
/// published output. Knows nothing of which tick is due.
class LawOnBus {
 public:
  LawOnBus(const experiment::Scenario& scenario, ScenarioLaw law, bus::Transport& transport,
           node::Session& session);
  ~LawOnBus();

  /// To be announced before the run.
  [[nodiscard]] const loop::LawInfo& info() const { return info_; }
  [[nodiscard]] const std::string& measurement_channel() const { return measurement_channel_; }
  [[nodiscard]] const std::string& reference_channel() const { return reference_channel_; }
  [[nodiscard]] const std::string& command_channel() const { return command_channel_; }
  [[nodiscard]] const std::string& state_channel() const { return state_channel_; }

  /// Longest messages [bytes].
  [[nodiscard]] std::size_t longest_measurement() const;
  [[nodiscard]] std::size_t longest_reference() const;
  [[nodiscard]] std::size_t longest_command() const;
  [[nodiscard]] std::size_t longest_state() const;

  /// Decodes a message: whether it is of this run and sound; counts it if not.
  bool accept_measurement(const bus::Datagram& datagram, loop::Stamp& stamp);
  bool accept_reference(const bus::Datagram& datagram, loop::Stamp& stamp);

  /// The message accepted last is the input of its tick. The last `MessageRing::depth` ticks'
  /// inputs are kept, in step with the bytes that protocol/ keeps.
  void keep_measurement(const loop::Stamp& stamp);
  void keep_reference(const loop::Stamp& stamp);

  /// What became of one tick. Bytes are valid until the next call.
  struct Result {
    std::span<const std::byte> command;
    std::span<const std::byte> state;
    std::int64_t skipped = 0;
    bool restarted = false;
  };

  /// Steps the law over `tick`, whose inputs have been kept, and publishes command and state.
  /// @throw diagnostics::Failure(protective_stop) when the result is not finite.
  Result step(std::int64_t tick);

  /// Steps the law over `tick`, whose command was published by a predecessor: for its memory alone.
  /// False, and nothing done, when one of the messages is damaged.
  [[nodiscard]] bool rebuild(std::int64_t tick, std::span<const std::byte> measurement,
                             std::span<const std::byte> reference);

 private:
  struct Messages;
  class Measured;
  template <class Measurement>
  class MeasuredBy;

  bus::Transport& transport_;
  node::Session& session_;
  loop::LawInfo info_;
  std::unique_ptr<Measured> measured_;  ///< what depends on the law's measurement type
  std::unique_ptr<Messages> messages_;  ///< what does not
  std::string measurement_channel_;
  std::string reference_channel_;
  std::string command_channel_;
  std::string state_channel_;
};

}  // namespace tachless::controller
