#pragma once

#include <cstdint>
#include <deque>
#include <random>
#include <stop_token>
#include <string>
#include <vector>

#include "base/clock.h"
#include "base/file_descriptor.h"
#include "base/quantities.h"
#include "plant/drivers/mit_can/drives.h"
#include "plant/drivers/mit_can/mit_driver.h"
#include "robot/model.h"
#include "scenario/scenario.h"

namespace tachless::mit_can {

/// Troubles of an emulated bus.
struct Trouble {
  double lost_share = 0;  ///< share of all frames, in both directions, that is lost
  std::uint64_t seed = 1;
  int motor = -1;           ///< index of the motor with a trouble of its own; -1: none
  std::int64_t after = 0;   ///< commands that the motor takes before its trouble
  bool silent = false;      ///< the motor stops answering
  int fault = 0;            ///< fault code with which the motor stops; 0: none
  bool bus_closes = false;  ///< the bus ends
  /// Torque range in the motor's register over that of the scenario.
  double torque_range_scale = 1;
};

/// Drives and arm of a scenario on an emulated bus, `plant.driver.bus: unix:PATH`. The arm is the
/// scenario's with its viscous friction. It has no brakes and stays in place while no drive is
/// enabled. Frames take their time on the bus. A drive whose watchdog gets no command in time stops
/// with its fault.
class EmulatedDrives {
 public:
  /// Listens on the bus's path, which it replaces.
  /// @throw base::Failure(bad_usage) when the bus is no unix:PATH or the path cannot be used
  EmulatedDrives(const scenario::Scenario& scenario, const Trouble& trouble = {});
  ~EmulatedDrives();
  EmulatedDrives(const EmulatedDrives&) = delete;
  EmulatedDrives& operator=(const EmulatedDrives&) = delete;

  /// Serves one client after the other until `ends` is requested.
  void serve(const std::stop_token& ends);

  // Read these once `serve` has returned.
  [[nodiscard]] std::int64_t frames() const { return frames_; }
  [[nodiscard]] std::int64_t lost() const { return lost_; }
  /// Returns the number of watchdogs that have stopped a drive.
  [[nodiscard]] int watchdogs() const { return watchdogs_; }
  [[nodiscard]] bool any_enabled() const;
  /// Positions about the URDF's axes [rad].
  [[nodiscard]] const Vector& positions() const { return q_; }

 private:
  struct Motor {
    Drive drive;
    Setpoint set;
    bool enabled = false, silent = false;
    int fault = 0;
    double applied = 0;  ///< [N m]
    double heard_s = 0, watchdog_s = 0;
    std::int64_t commands = 0;
    std::uint32_t mode = 99;
  };
  struct Due {
    double at_s = 0;
    Frame frame;
    bool command = false;  ///< the frame goes to the drives
  };

  [[nodiscard]] double now_s() const;
  void serve_client(int client, const std::stop_token& ends);
  void take_frames(int client, bool& open);
  void deliver(int client, bool& open);
  void handle(const Frame& frame, double at_s);
  void handle_register(Motor& motor, const Frame& frame, double at_s);
  void begin_trouble(Motor& motor, std::size_t index);
  void answer(const Frame& frame, double at_s);
  void move_on(double until_s);
  [[nodiscard]] bool loses();

  Settings settings_;
  Trouble trouble_;
  robot::Model model_;
  Vector signs_, offsets_, viscous_;
  std::string path_;
  base::FileDescriptor listener_;
  std::vector<Motor> motors_;
  Vector q_, v_;
  base::Clock::time_point begin_ = base::Clock::now();
  double frame_s_, arm_s_ = 0, bus_s_ = 0;
  std::deque<Due> line_;
  std::mt19937_64 random_;
  std::int64_t frames_ = 0, lost_ = 0;
  int watchdogs_ = 0;
  bool closed_ = false;
};

}  // namespace tachless::mit_can
