#pragma once

#include <cstdint>
#include <filesystem>

#include "bus/key.h"
#include "logger/recorder.h"
#include "protocol/lockstep/log_window.h"

namespace tachless::logger {

/// Records tick by tick, each complete and once, stamped with simulation time; acknowledges, and
/// has what it misses repeated. Announcements are not recorded, but for the fault that ends the log
/// of a run that has failed.
class LockstepRecorder final : public Recorder {
 public:
  LockstepRecorder(const experiment::Scenario& scenario, bus::Transport& transport,
                   node::Link& link, const std::filesystem::path& log_path);

 private:
  protocol::lockstep::Verdict take_run_info(bool same) override {
    return window_.on_run_info(same);
  }
  void on_message(Slot slot, const loop::Stamp& stamp, const bus::Datagram& datagram) override;
  void after_message() override;
  [[nodiscard]] bool complete(loop::Clock::time_point /*now*/) const override {
    return window_.all_written();
  }
  void conclude(bool well) override;
  [[nodiscard]] std::int64_t utime() const override { return utime_; }

  void write_complete_ticks();
  void compare_truth();

  protocol::lockstep::LogWindow window_;
  bus::Digest truth_digest_;  ///< of what is written
  std::int64_t utime_ = 0;    ///< of the last tick written
};

}  // namespace tachless::logger
