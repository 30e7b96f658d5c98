#include "tests/support/in_process_log.h"

#include "study/in_process_log.h"

namespace tachless::support {

std::vector<logger::Recorded> in_process_log(const experiment::Scenario& scenario,
                                             std::int64_t run) {
  std::vector<logger::Recorded> messages;
  study::log_in_process(
      scenario, controller::scenario_law(scenario), run,
      [&](const study::LogMessage& message) {
        messages.push_back(
            {message.utime,
             std::string(message.channel),
             {reinterpret_cast<const char*>(message.data.data()), message.data.size()}});
      },
      [](const study::TickRecord&) { return true; });
  return messages;
}

experiment::Scenario shortened(const std::string& file, const std::string& duration_s,
                               std::vector<std::string> overrides) {
  overrides.push_back("loop.duration_s=" + duration_s);
  return experiment::load_scenario(std::string(TACHLESS_SOURCE_DIR "/scenarios/") + file,
                                   overrides);
}

}  // namespace tachless::support
