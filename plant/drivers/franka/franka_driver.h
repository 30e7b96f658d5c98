#pragma once

#include <franka/active_control_base.h>
#include <franka/exception.h>
#include <franka/robot.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "base/clock.h"
#include "base/schema.h"
#include "plant/robot_driver.h"
#include "robot/model.h"
#include "scenario/scenario.h"
#include "session/statistics.h"

namespace tachless::fci {

/// Load that the arm adds gravity for, `plant.driver.load`.
struct Load {
  double mass_kg = 0;
  std::vector<double> center_m = {0, 0, 0};
  std::vector<double> inertia_kgm2 = {0, 0, 0};

  static constexpr std::tuple keys{
      base::Key{"mass_kg", &Load::mass_kg, "kg", "Mass"}.in({0, 10}).by_default(),
      base::Key{"center_m", &Load::center_m, "m", "Centre of mass in the flange's frame"}
          .by_default(),
      base::Key{"inertia_kgm2", &Load::inertia_kgm2, "kg m²",
                "Principal moments of inertia, along the flange's axes"}
          .in(base::not_negative)
          .by_default()};

  [[nodiscard]] std::optional<base::Refusal> refusal() const;
};

/// `plant.driver` of this driver.
struct Settings {
  std::string address;
  bool recover = false;
  std::vector<double> collision_torque_Nm = {20, 20, 18, 18, 16, 14, 12};
  std::vector<double> collision_force_N = {20, 20, 20};
  std::vector<double> collision_moment_Nm = {25, 25, 25};
  Load load;

  static constexpr std::tuple keys{
      base::Key{"address", &Settings::address, "", "Name or IP address of the arm's control"},
      base::Key{"recover", &Settings::recover, "",
                "An arm in a reflex recovers from it before the run"}
          .by_default(),
      base::Key{"collision_torque_Nm", &Settings::collision_torque_Nm, "N m",
                "External torque that is a collision, of each joint"}
          .in(base::positive)
          .by_default(),
      base::Key{"collision_force_N", &Settings::collision_force_N, "N",
                "External force that is a collision, along x, y, z"}
          .in(base::positive)
          .by_default(),
      base::Key{"collision_moment_Nm", &Settings::collision_moment_Nm, "N m",
                "External moment that is a collision, about x, y, z"}
          .in(base::positive)
          .by_default(),
      base::Key{"load", &Settings::load}};

  [[nodiscard]] std::optional<base::Refusal> refusal() const;
};

/// Returns the model that an arm reports, as the text of a URDF.
/// @throw base::Failure(bad_usage) when the arm cannot be reached
std::string told_urdf(const std::string& address);

/// A Franka arm by libfranka (docs/drivers/franka.md). The arm is the clock: 1 kHz. Each tick
/// answers the last state with a torque and waits for the next state. The change of the torque is
/// limited from the torque that the arm reports as accepted. A lost torque therefore makes no
/// discontinuity.
///
/// Four properties of libfranka are avoided. The destructor of its control object throws if the arm
/// rejects its request, which ends the process. The driver never calls this destructor. A read by
/// the control object and StopMove wait for an answer without a time limit. The driver reads states
/// by the robot object, and sends StopMove from a thread of its own. States queue while nobody
/// reads. The driver passes over old states. Connecting sets the thread's priority to 99. The
/// driver restores the thread's own priority.
class FrankaDriver final : public plant::ClockDriver {
 public:
  /// Connects, recovers if plant.driver.recover is set, and compares the joints' limits with the
  /// limits that the arm reports.
  /// @throw base::Failure(bad_usage) naming address, cause and remedy
  explicit FrankaDriver(const scenario::Scenario& scenario);
  FrankaDriver(const FrankaDriver&) = delete;
  FrankaDriver& operator=(const FrankaDriver&) = delete;
  ~FrankaDriver() override;

  /// Returns false: the arm's velocity is a filtered difference of its positions.
  [[nodiscard]] bool measures_velocity() const override { return false; }
  void start() override;
  void stop() override;
  [[nodiscard]] std::vector<plant::DriverFigure> figures() const override;

 private:
  void recover();
  void require_idle() const;
  void compare_limits(const scenario::Scenario& scenario) const;
  void set_load();
  plant::ArmState exchange(const Vector& tau) override;
  void send(const Vector& tau);
  /// Reads a state of the present. Blocks until one comes, for a second at most.
  void update();
  void require_moving();
  /// Returns the arm's reason for its stop, and the remedy.
  [[nodiscard]] std::string reason() const;
  /// Calls `call`, and turns libfranka's exceptions into the run's failure.
  template <class Call>
  void guarded(const Call& call);

  Settings settings_;
  std::shared_ptr<franka::Robot> robot_;
  std::unique_ptr<franka::ActiveControlBase> control_;
  franka::RobotState now_;
  base::Clock::time_point read_at_;
  bool running_ = false;  ///< the arm takes torques
  bool lost_ = false;     ///< the connection is lost
  int unmoved_ = 0;  ///< number of states from the start to the first state in which the arm moves
  bool moved_ = false;
  std::int64_t ticks_ = 0, limited_ = 0;  ///< ticks in motion; ticks with a limited torque
  double rate_sum_ = 0, lowest_rate_ = 1, last_rate_ = 1;
  session::LatencyHistogram answers_;
};

}  // namespace tachless::fci
