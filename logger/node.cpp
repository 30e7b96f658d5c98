#include "logger/node.h"

#include "logger/lockstep_recorder.h"
#include "logger/realtime_recorder.h"

namespace tachless::logger {

void run_node(const experiment::Scenario& scenario, bus::Transport& transport, node::Link& link,
              const std::filesystem::path& log_path) {
  if (scenario.loop.mode == experiment::Mode::realtime) {
    RealtimeRecorder(scenario, transport, link, log_path).run();
  } else {
    LockstepRecorder(scenario, transport, link, log_path).run();
  }
}

}  // namespace tachless::logger
