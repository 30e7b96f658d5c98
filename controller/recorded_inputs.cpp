#include "controller/recorded_inputs.h"

#include <utility>

#include "bus/wire.h"

namespace tachless::controller {

RecordedInputs::RecordedInputs(const std::filesystem::path& log, std::string measurement_channel,
                               std::string reference_channel, std::int64_t run)
    : log_(log),
      measurement_channel_(std::move(measurement_channel)),
      reference_channel_(std::move(reference_channel)),
      run_(run) {}

std::optional<RecordedInputs::Tick> RecordedInputs::next() {
  Tick tick{next_, {}, {}};
  while (const auto event = log_.next()) {
    const bool measured = event->channel == measurement_channel_;
    if (!measured && event->channel != reference_channel_) continue;
    if (event->data.size() < bus::stamp_end) return {};
    const loop::Stamp stamp = bus::stamp_of(event->data);
    if (stamp.run != run_) throw unusable("it is of run " + std::to_string(stamp.run));
    if (stamp.tick != next_) return {};
    (measured ? tick.measurement : tick.reference) = event->data;
    if (tick.measurement.empty() || tick.reference.empty()) continue;
    ++next_;
    return tick;
  }
  return {};
}

diagnostics::Failure RecordedInputs::unusable(const std::string& why) const {
  return {diagnostics::ExitCode::bad_usage, "cannot resume run " + std::to_string(run_) + " from " +
                                                log_.path().string() + ": " + why +
                                                "; start a new run"};
}

}  // namespace tachless::controller
