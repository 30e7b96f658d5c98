#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "logger/recorder.h"
#include "protocol/lockstep/log_window.h"

namespace tachless::logger {

/// Records tick by tick, each complete and once, stamped with simulation time; acknowledges, and
/// has what it misses repeated. Announcements are not recorded, but for one after the last tick of
/// a run that has failed: the fault, as the failing process announced it.
class LockstepRecorder final : public Recorder {
 public:
  LockstepRecorder(const experiment::Scenario& scenario, bus::Transport& transport,
                   node::Link& link, const std::filesystem::path& log_path);

 private:
  protocol::lockstep::Verdict take_run_info(bool same) override {
    return window_.on_run_info(same);
  }
  void on_message(Slot slot, const loop::Stamp& stamp, const bus::Datagram& datagram) override;
  void on_participant(const bus::Datagram& datagram) override;
  void after_message() override;
  void conclude(bool well) override;

  void write_complete_ticks();

  protocol::lockstep::LogWindow window_;
  bus::Codec<loop::Participant> participant_codec_;
  std::int64_t utime_ = 0;  ///< of the last tick written
  bool concluding_ = false;
  std::string fault_channel_;
  std::vector<std::byte> fault_;  ///< the last announced one; empty: none
};

}  // namespace tachless::logger
