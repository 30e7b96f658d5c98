#include "node/run_info.h"

#include "bus/wire.h"
#include "diagnostics/version.h"

namespace tachless::node {

std::vector<std::byte> run_info(const experiment::Scenario& scenario, std::int64_t run,
                                const loop::LawInfo& law) {
  loop::RunInfo info;
  static_cast<loop::LawInfo&>(info) = law;
  info.num_ticks = scenario.loop.num_ticks;
  info.period_s = scenario.loop.period_s;
  info.version = diagnostics::version;
  info.robot = scenario.robot.channel_prefix;
  info.scenario = scenario.text;
  info.robot_description = scenario.robot.urdf_text;
  bus::Codec<loop::RunInfo> codec(
      loop::layout(scenario.num_joints, scenario.robot.flexible.has_value()));
  const auto bytes = codec.encode({0, run, -1}, info);
  return {bytes.begin(), bytes.end()};
}

}  // namespace tachless::node
