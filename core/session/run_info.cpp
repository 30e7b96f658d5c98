#include "session/run_info.h"

#include "base/version.h"
#include "messages/wire.h"

namespace tachless::session {

std::vector<std::byte> run_info(const scenario::Scenario& scenario, std::int64_t run,
                                const messages::LawInfo& law) {
  messages::RunInfo info;
  static_cast<messages::LawInfo&>(info) = law;
  info.num_ticks = scenario.loop.num_ticks;
  info.period_s = scenario.loop.period_s;
  info.version = base::version;
  info.robot = scenario.robot.channel_prefix;
  info.scenario = scenario.text;
  info.robot_description = scenario.robot.urdf_text;
  messages::Codec<messages::RunInfo> codec(
      messages::layout(scenario.num_joints, scenario.robot.flexible.has_value()));
  const auto bytes = codec.encode({0, run, -1}, info);
  return {bytes.begin(), bytes.end()};
}

}  // namespace tachless::session
