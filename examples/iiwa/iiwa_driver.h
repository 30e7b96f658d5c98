#pragma once

#include <tachless/base/failure.h>
#include <tachless/plant/robot_driver.h>
#include "channels.h"

namespace tachless::iiwa {

inline Vector vector_of(const std::vector<double>& numbers) {
  const auto size = std::min<std::size_t>(numbers.size(), max_joints);
  return Eigen::Map<const Eigen::VectorXd>(numbers.data(), static_cast<Eigen::Index>(size));
}

/// The arm behind drake-iiwa-driver. The arm is the clock: it answers each status with a torque.
class IiwaDriver final : public plant::ClockDriver {
 public:
  explicit IiwaDriver(const bus::LcmUrl& url) : channels_(url, command_channel, status_channel) {}

  // The status contains a filtered difference of positions as velocity, which is for the log only.
  [[nodiscard]] bool measures_velocity() const override { return false; }

  void start() override {}  // torque mode is chosen at the pendant
  void stop() override {    // after 50 ms without a command drake-iiwa-driver holds the arm
    if (status_.num_joints > 0) send(Vector::Zero(status_.num_joints));
  }

 private:
  plant::ArmState exchange(const Vector& tau) override {
    if (tau.size() > 0) send(tau);
    // The first wait is long, because the driver may just have started. Ticks that pass meanwhile
    // count as missed; without commands drake-iiwa-driver holds the arm itself.
    const std::chrono::milliseconds longest(status_.num_joints == 0 ? 3000 : 500);
    if (!channels_.receive(status_, base::Clock::now() + longest)) {
      throw base::Failure(base::ExitCode::protective_stop,
                          "no message on {} for {} ms: does drake-iiwa-driver run, on this "
                          "LCM URL, and is the arm in torque mode?",
                          status_channel, longest.count());
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

  Channels<drake::lcmt_iiwa_command, drake::lcmt_iiwa_status> channels_;
  drake::lcmt_iiwa_status status_{};
  drake::lcmt_iiwa_command command_{};
};

}  // namespace tachless::iiwa
