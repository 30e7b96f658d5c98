#pragma once

#include <fmt/format.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "bus/wire.h"
#include "diagnostics/failure.h"
#include "logger/log_file.h"

namespace tachless::controller {

/// What one lockstep run's controller was given, tick by tick from 0 on, out of the run's log.
/// Reads its two channels and no other: what else the log holds, truth too, is passed over unread.
class RecordedInputs {
 public:
  struct Tick {
    std::int64_t tick = 0;
    std::span<const std::byte> measurement;  ///< valid as long as this object
    std::span<const std::byte> reference;
  };

  /// @throw diagnostics::Failure(bad_usage) when the log cannot be read.
  RecordedInputs(const std::filesystem::path& log, std::string measurement_channel,
                 std::string reference_channel, std::int64_t run)
      : log_(log),
        measurement_channel_(std::move(measurement_channel)),
        reference_channel_(std::move(reference_channel)),
        run_(run) {}

  /// The next tick, while both its messages are there and no tick is missing before it.
  std::optional<Tick> next() {
    Tick tick{next_, {}, {}};
    while (const auto event = log_.next()) {
      const bool measured = event->channel == measurement_channel_;
      if (!measured && event->channel != reference_channel_) continue;
      if (event->data.size() < bus::stamp_end) return {};
      const loop::Stamp stamp = bus::stamp_of(event->data);
      if (stamp.run != run_) throw unusable(fmt::format("it is of run {}", stamp.run));
      if (stamp.tick != next_) return {};
      (measured ? tick.measurement : tick.reference) = event->data;
      if (tick.measurement.empty() || tick.reference.empty()) continue;
      ++next_;
      return tick;
    }
    return {};
  }

  /// The tick that `next` would give.
  [[nodiscard]] std::int64_t next_tick() const { return next_; }

  /// Why the run cannot be resumed from this log.
  [[nodiscard]] diagnostics::Failure unusable(std::string_view why) const {
    return diagnostics::bad_usage("cannot resume run {} from {}: {}; start a new run", run_,
                                  log_.path().string(), why);
  }

 private:
  logger::LogReader log_;
  std::string measurement_channel_;
  std::string reference_channel_;
  std::int64_t run_;
  std::int64_t next_ = 0;
};

}  // namespace tachless::controller
