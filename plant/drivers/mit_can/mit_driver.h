#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "base/clock.h"
#include "base/schema.h"
#include "plant/drive_loop.h"
#include "plant/drivers/mit_can/can_bus.h"
#include "plant/drivers/mit_can/drives.h"
#include "robot/model.h"
#include "scenario/scenario.h"

namespace tachless::mit_can {

/// A motor of `plant.driver.motors`, in the order of the URDF's joints.
struct MotorSettings {
  Model model = Model::damiao;
  int id = 0;
  int reply_id = 0;  ///< 0: the default of the family
  std::optional<double> position_max_rad, velocity_max_rad_per_s, torque_max_Nm;

  static constexpr std::tuple keys{
      base::Key{"model", &MotorSettings::model, "",
                "Its ranges; `damiao` and `robstride` take them from the three keys below"},
      base::Key{"id", &MotorSettings::id, "", "Of the commands"}.in({1, 2047}),
      base::Key{"reply_id", &MotorSettings::reply_id, "",
                "Of the answers; of a RobStride the host's, at most 255"}
          .in({0, 2047})
          .by_default("Damiao: id + 16; RobStride: 253"),
      base::Key{"position_max_rad", &MotorSettings::position_max_rad, "rad",
                "Range of positions, both ways"}
          .in(base::positive)
          .by_default("the model's"),
      base::Key{"velocity_max_rad_per_s", &MotorSettings::velocity_max_rad_per_s, "rad/s",
                "Range of velocities"}
          .in(base::positive)
          .by_default("the model's"),
      base::Key{"torque_max_Nm", &MotorSettings::torque_max_Nm, "N m", "Range of torques"}
          .in(base::positive)
          .by_default("the model's")};

  [[nodiscard]] std::optional<base::Refusal> refusal() const;
  [[nodiscard]] Drive drive() const;
};

/// `plant.driver` of this driver.
struct Settings {
  std::string bus;
  bool fd = false;
  std::vector<MotorSettings> motors;
  double watchdog_s = 0.1;
  double answer_wait_s = 0;  ///< 0: a tenth of the period
  Vector brake_kp_Nm_per_rad, brake_kd_Nms_per_rad;
  double brake_gravity_m_per_s2 = 9.81;

  static constexpr std::tuple keys{
      base::Key{"bus", &Settings::bus, "",
                "Network interface, such as can0; unix:PATH emulates one"},
      base::Key{"fd", &Settings::fd, "", "Frames of CAN-FD"}.by_default(),
      base::Key{"motors", &Settings::motors, "", "A motor for each joint, in the URDF's order"},
      base::Key{"watchdog_s", &Settings::watchdog_s, "s",
                "The drives stop when no command has come for so long"}
          .in({1e-3, 10})
          .by_default(),
      base::Key{"answer_wait_s", &Settings::answer_wait_s, "s",
                "A tick waits so long for the answers to the last commands"}
          .in({0, 1})
          .by_default("a tenth of loop.period_s"),
      base::Key{"brake_kp_Nm_per_rad", &Settings::brake_kp_Nm_per_rad, "N m/rad",
                "Stiffness of the drives before the first torque and after the last"}
          .in(base::not_negative)
          .by_default(20),
      base::Key{"brake_kd_Nms_per_rad", &Settings::brake_kd_Nms_per_rad, "N m s/rad",
                "Damping of the same"}
          .in(base::not_negative)
          .by_default(1),
      base::Key{"brake_gravity_m_per_s2", &Settings::brake_gravity_m_per_s2, "m/s2",
                "Gravity that the brake carries in every run, in the direction of the scenario's; "
                "the trials of commission state a share of gravity"}
          .in(base::not_negative)
          .by_default()};
};

/// An arm whose drives have the MIT mode, on one CAN bus. Commands are torques alone (kp = kd = 0),
/// so that the law is the only feedback. With plant.drive.loop they are set points, that loop's
/// gains and torques. Each drive answers a command with its position at that
/// moment; `read` takes the answers to the commands of the tick before. A tick in which an answer
/// is missing has no reading.
///
/// The drives have no brakes. Before the first torque and from `stop` on each drive holds its
/// position by its own gains, with gravity's torque of the scenario's model.
class MitDriver final : public plant::DriveLoopDriver {
 public:
  /// Opens the bus, sets mode and watchdog of each drive and reads back what can be read.
  /// @param scenario outlives the driver
  /// @throw base::Failure(bad_usage) naming the motor, or the key of plant.driver
  explicit MitDriver(const scenario::Scenario& scenario);
  MitDriver(const MitDriver&) = delete;
  MitDriver& operator=(const MitDriver&) = delete;
  /// Disables the drives.
  ~MitDriver() override;

  [[nodiscard]] bool measures_velocity() const override { return true; }
  void start() override;
  plant::ArmState read() override;
  void hold(const Vector& tau, double until_s) override;
  void follow(const Vector& tau, const plant::SetPoint& set_point, double until_s) override;
  void stop() override;
  void rest(double until_s) override;
  [[nodiscard]] std::vector<plant::DriverFigure> figures() const override;

 private:
  struct Motor {
    Drive drive;
    std::string label;  ///< "motor 3 (elbow)"
    Answer answer;
    bool answered = false;
    /// First reading without an answer since the last answer; nothing: it answered.
    std::optional<base::Clock::time_point> silent_since;
    std::int64_t lost = 0;
    double hottest = 0;
    Setpoint brake;
    double torque_rest = 0;  ///< left over by the frames' counts [N m]
  };

  void set_up(const Motor& motor);
  /// Refuses gains of plant.drive.loop beyond the ranges of the frames.
  void require_gains() const;
  void require_range(const Motor& motor, Register which, double expected);
  [[nodiscard]] std::uint32_t read_back(const Motor& motor, Register which);
  void ask_all();
  void send(const Frame& frame);
  /// Takes what has arrived, and waits until all motors have answered or the time is over.
  void collect(std::chrono::nanoseconds longest);
  void take(const Frame& frame);
  /// Counts the ticks in a row without an answer of each motor.
  /// @throw base::Failure(protective_stop) after too many ticks
  void count_silence();
  void require_sound(const Motor& motor) const;
  [[nodiscard]] Vector told_position() const;  ///< of the drives' last answers [rad]
  /// Lets the drives' own gains hold the joints until they rest, for 0.2 s to 1 s.
  void settle();
  void set_brake();
  void send_brake();
  /// Sends each motor its set point, `set_point(index)`.
  template <class SetpointOf>
  void command_each(const SetpointOf& set_point);

  const scenario::Scenario& scenario_;
  Settings settings_;
  std::optional<scenario::DriveLoopSpec> drive_loop_;
  robot::Model model_;
  CanBus bus_;
  std::vector<Motor> motors_;
  std::chrono::nanoseconds wait_;
  bool expecting_ = false;  ///< a frame that drives answer was sent since the last `read`
  bool started_ = false, stopped_ = false;
  std::int64_t expected_ = 0, unsent_ = 0;
};

}  // namespace tachless::mit_can
