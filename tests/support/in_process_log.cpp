#include "tests/support/in_process_log.h"

#include "in_process/in_process_log.h"

namespace tachless::support {

std::vector<logger::Recorded> in_process_log(const scenario::Scenario& scenario, std::int64_t run) {
  std::vector<logger::Recorded> messages;
  in_process::log_in_process(
      scenario, controller::scenario_law(scenario), run,
      [&](const in_process::LogMessage& message) {
        messages.push_back(
            {message.utime,
             std::string(message.channel),
             {reinterpret_cast<const char*>(message.data.data()), message.data.size()}});
      },
      [](const in_process::TickRecord&) { return true; });
  return messages;
}

scenario::Scenario shortened(const std::string& file, const std::string& duration_s,
                             std::vector<std::string> overrides) {
  overrides.push_back("loop.duration_s=" + duration_s);
  return scenario::load_scenario(std::string(TACHLESS_SOURCE_DIR "/scenarios/") + file, overrides);
}

}  // namespace tachless::support
