// A KUKA LBR iiwa behind drake-iiwa-driver, as the plant of a run: docs/real_robot.md. Run
// drake-iiwa-driver with --torque_only --time_step=0.001 (the period of the scenario). Without
// --torque_only it holds the last torque when commands cease.

#include <tachless/base/failure.h>
#include <tachless/plant/node.h>
#include <tachless/plant/robot_driver.h>
#include <tachless/session/options.h>
#include <tachless/session/run_role.h>
#include "channels.h"

using namespace tachless;

namespace {

using namespace std::chrono_literals;

Vector vector_of(const std::vector<double>& numbers) {
  const auto size = std::min<std::size_t>(numbers.size(), max_joints);
  return Eigen::Map<const Eigen::VectorXd>(numbers.data(), static_cast<Eigen::Index>(size));
}

class IiwaDriver final : public plant::ClockDriver {
 public:
  explicit IiwaDriver(const bus::LcmUrl& url)
      : channels_(url, iiwa::command_channel, iiwa::status_channel) {}

  // The status contains a filtered difference of positions as velocity, which is for the log only.
  [[nodiscard]] bool measures_velocity() const override { return false; }

  void start() override {}  // torque mode is chosen at the pendant

  void stop() override {
    // After 50 ms without a command drake-iiwa-driver holds the arm in place.
    if (status_.num_joints > 0) send(Vector::Zero(status_.num_joints));
  }

 private:
  plant::ArmState exchange(const Vector& tau) override {
    if (tau.size() > 0) send(tau);
    // The first wait is long because the driver may just have been started. Later waits are safe:
    // without commands drake-iiwa-driver holds the arm itself (`stop`). Ticks that pass meanwhile
    // are counted as missed.
    const std::chrono::milliseconds longest = status_.num_joints == 0 ? 3000ms : 500ms;
    if (!channels_.receive(status_, base::Clock::now() + longest)) {
      throw base::Failure(base::ExitCode::protective_stop,
                          "no message on {} for {} ms: does drake-iiwa-driver run, on this "
                          "LCM URL, and is the arm in torque mode?",
                          iiwa::status_channel, longest.count());
    }
    plant::ArmState state;
    state.q = vector_of(status_.joint_position_measured);
    state.v = vector_of(status_.joint_velocity_estimated);
    state.time_s = 1e-6 * static_cast<double>(status_.utime);
    return state;
  }

  void send(const Vector& tau) {
    command_.utime = status_.utime;
    // Set-points equal to the measured positions give a stiffness no torque.
    command_.num_joints = status_.num_joints;
    command_.joint_position = status_.joint_position_measured;
    command_.num_torques = static_cast<std::int32_t>(tau.size());
    command_.joint_torque.assign(tau.begin(), tau.end());
    channels_.send(command_);
  }

  iiwa::Channels<drake::lcmt_iiwa_command, drake::lcmt_iiwa_status> channels_;
  drake::lcmt_iiwa_status status_{};
  drake::lcmt_iiwa_command command_{};
};

}  // namespace

int main(int argc, char** argv) {
  constexpr auto role = messages::Role::plant;
  return session::run_process(role, argc, argv, [](const session::ProcessOptions& options) {
    IiwaDriver driver(session::parse_lcm_url(options.lcm_url));
    return session::run_role(role, options, [&driver](const auto& scenario, auto& link) {
      if (scenario.robot.channel_prefix == "IIWA") {
        throw scenario.complaint("robot.name",
                                 "iiwa: IIWA_COMMAND is drake-iiwa-driver's; take another name");
      }
      plant::run_driver(scenario, link, driver);
    });
  });
}
