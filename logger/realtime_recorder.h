#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "logger/recorder.h"
#include "logger/tick_tally.h"
#include "protocol/realtime/realtime.h"

namespace tachless::logger {

/// Records in order of arrival, each message once, PARTICIPANT included, stamped with the time of
/// arrival since the first tick. Nothing is repeated for it; what never came is counted at the end,
/// by channel and tick.
class RealtimeRecorder final : public Recorder {
 public:
  RealtimeRecorder(const experiment::Scenario& scenario, bus::Transport& transport,
                   node::Link& link, const std::filesystem::path& log_path);

 private:
  protocol::lockstep::Verdict take_run_info(bool same) override;
  void on_message(Slot slot, const loop::Stamp& stamp, const bus::Datagram& datagram) override;
  void on_participant(const bus::Datagram& datagram) override;
  void after_message() override;
  [[nodiscard]] bool complete(loop::Clock::time_point now) const override;
  void conclude(bool well) override;
  [[nodiscard]] std::int64_t utime() const override { return since_start(loop::Clock::now()); }

  [[nodiscard]] std::int64_t since_start(loop::Clock::time_point now) const;
  void tell_what_is_missing();

  std::int64_t num_ticks_;
  bool introduced_ = false;
  bool acknowledgement_due_ = false;
  protocol::realtime::Pace pace_;
  TickTally tally_;
  std::optional<loop::Clock::time_point> start_;  ///< of tick 0, as seen from here
  int silent_waits_ = 0;  ///< of the conclusion, since the last message of a tick
};

}  // namespace tachless::logger
