#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "base/file_descriptor.h"
#include "base/quantities.h"
#include "robot/model.h"
#include "scenario/scenario.h"

namespace tachless::ur {

/// Events of a controller's motion. Each is at the number of a torque.
struct Trouble {
  static constexpr std::int64_t never = std::numeric_limits<std::int64_t>::max();
  std::int64_t protective_stop_at = never;
  std::int64_t program_ends_at = never;
  std::int64_t silent_from = never;  ///< the connection stays open
};

/// The controller of an arm of Universal Robots as the maker's library needs it, on 127.0.0.1: RTDE
/// (port 30004), the configuration of the primary interface (30001), and the sides of the arm's
/// program in the connections for torques, trajectories and script commands (50001, 50003, 50004).
/// The arm is the scenario's without gravity, which it adds, at 500 Hz. Its program brakes the arm
/// when no torque has come within the time-out that the last one named. A torque that answers a
/// state acts from the arm's next step on. The program starts when the
/// primary interface has got a script. The script itself is not run.
class EmulatedController {
 public:
  /// @throw base::Failure(bad_usage) when a port is taken or the robot has not six joints
  explicit EmulatedController(const scenario::Scenario& scenario, Trouble trouble = {});

  /// Serves one client of the library after the other until `ends` is requested.
  void serve(const std::stop_token& ends);

  // Read these once `serve` has returned.
  std::int64_t torques = 0;          ///< that came
  std::vector<std::int32_t> scales;  ///< of friction, in millionths; empty: not set
  bool program_runs = false;

 private:
  void serve_primary();
  void serve_rtde();
  void answer(char type, std::string_view body);
  void send_state();
  void start_program();
  void end_program();
  void take_torques();
  void take_script_commands();
  void move();

  Trouble trouble_;
  robot::Model model_;
  Vector q_, v_, acting_;
  base::FileDescriptor primary_listener_, rtde_listener_;
  base::FileDescriptor primary_, rtde_, torque_, trajectory_, script_;
  std::string primary_in_, rtde_in_, torque_in_, script_in_;
  std::vector<std::string> recipe_;
  bool sends_ = false, torque_mode_ = false;
  bool starts_ = false;      ///< a script has come, and its program has not connected yet
  std::int32_t safety_ = 1;  // normal
  std::int64_t tick_ = 0;
  double timeout_s_ = 0, heard_s_ = 0;
};

}  // namespace tachless::ur
