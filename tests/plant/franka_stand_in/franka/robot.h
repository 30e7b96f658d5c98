#pragma once

// Names of libfranka's franka/robot.h, robot_state.h, errors.h and duration.h that the driver uses,
// over a client of our own. It has the four habits of libfranka that docs/drivers/franka.md
// describes: a destructor that stops the arm and may end the process, waits without an end, states
// that pile up, and a thread priority that it sets.

#include <netinet/in.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>

#include "base/file_descriptor.h"
#include "franka/active_control_base.h"
#include "franka/exception.h"
#include "plant/drivers/franka/fci.h"

namespace franka {

enum class RobotMode {
  kOther,
  kIdle,
  kMove,
  kGuiding,
  kReflex,
  kUserStopped,
  kAutomaticErrorRecovery
};

struct Errors {
  std::array<bool, 41> all{};
  bool joint_position_limits_violation = false, self_collision_avoidance_violation = false,
       joint_velocity_violation = false, cartesian_velocity_violation = false, joint_reflex = false,
       cartesian_reflex = false, communication_constraints_violation = false,
       controller_torque_discontinuity = false, power_limit_violation = false,
       tau_j_range_violation = false;
  explicit operator std::string() const;
};

class Duration {
 public:
  explicit Duration(std::uint64_t milliseconds = 0) : milliseconds_(milliseconds) {}
  [[nodiscard]] double toSec() const noexcept { return 1e-3 * static_cast<double>(milliseconds_); }

 private:
  std::uint64_t milliseconds_;
};

struct RobotState {
  double m_ee = 0, m_load = 0;
  std::array<double, 7> tau_J{}, tau_J_d{}, q{}, dq{};
  Errors last_motion_errors;
  double control_command_success_rate = 0;
  RobotMode robot_mode = RobotMode::kUserStopped;
  Duration time;
};

class Robot {
 public:
  Robot(const std::string& address, RealtimeConfig config);
  Robot(const Robot&) = delete;
  Robot& operator=(const Robot&) = delete;
  ~Robot() = default;

  RobotState readOnce();
  std::string getRobotModel();
  void setCollisionBehavior(const std::array<double, 7>& lower_torques_acceleration,
                            const std::array<double, 7>& upper_torques_acceleration,
                            const std::array<double, 7>& lower_torques_nominal,
                            const std::array<double, 7>& upper_torques_nominal,
                            const std::array<double, 6>& lower_forces_acceleration,
                            const std::array<double, 6>& upper_forces_acceleration,
                            const std::array<double, 6>& lower_forces_nominal,
                            const std::array<double, 6>& upper_forces_nominal);
  void setLoad(double mass, const std::array<double, 3>& center,
               const std::array<double, 9>& inertia);
  void automaticErrorRecovery();
  std::unique_ptr<ActiveControlBase> startTorqueControl();
  void stop();

 private:
  friend class ActiveTorqueControl;
  struct Answer {
    std::uint8_t status = 0;
    std::string more;
  };
  /// Sends a request and waits for its answer without an end.
  Answer ask(tachless::fci::Request request, std::span<const std::byte> payload);
  void command(tachless::fci::Request request, std::span<const std::byte> payload);
  void require_connection() const;

  tachless::base::FileDescriptor tcp_, udp_;
  std::mutex asking_, receiving_;
  sockaddr_in server_{};
  std::uint32_t next_id_ = 0;
  tachless::fci::State state_;
};

}  // namespace franka
