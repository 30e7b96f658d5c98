#include "logger/node.h"

#include "logger/lockstep_recorder.h"
#include "logger/realtime_recorder.h"

namespace logger {

void run_node(const app::Scenario& scenario, bus::Transport& transport, app::Session& session,
              const std::filesystem::path& log_path) {
  if (scenario.loop.mode == app::Mode::realtime) {
    RealtimeRecorder(scenario, transport, session, log_path).run();
  } else {
    LockstepRecorder(scenario, transport, session, log_path).run();
  }
}

}  // namespace logger
