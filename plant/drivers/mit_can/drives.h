#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "plant/drivers/mit_can/can_bus.h"

/// Drives with the "MIT mode": a frame carries position, velocity, two gains and a torque, and the
/// drive answers with position, velocity and torque. The functions are pure and convert between
/// values and frames.
///
/// Sources of the layouts and ranges: enactic/openarm_can (dm_motor_control.cpp,
/// dm_motor_constants.hpp) for Damiao; RobStride/Python_Sample (bus.py, table.py, protocol.py) for
/// RobStride; project-sternbergia/cybergear_m5 (cybergear_driver.cpp) for CyberGear. No code was
/// copied from these sources.
namespace tachless::mit_can {

enum class Family {
  damiao,     ///< 11-bit identifiers; q 16, v 12, kp 12, kd 12, tau 12 bits
  robstride,  ///< 29-bit identifiers; all 16 bits; CyberGear too
};

/// Models whose ranges are known. The first two take their ranges from the scenario.
enum class Model {
  damiao,
  robstride,
  dm3507,
  dm4310,
  dm4310_48v,
  dm4340,
  dm6006,
  dm8006,
  dm8009,
  dm10010l,
  dm10010,
  rs00,
  rs01,
  rs02,
  rs03,
  rs04,
  rs05,
  rs06,
  cybergear,
};
constexpr std::array<std::string_view, 19> names(Model /*type*/) {
  return {"damiao", "robstride", "dm3507",   "dm4310",  "dm4310_48v", "dm4340", "dm6006",
          "dm8006", "dm8009",    "dm10010l", "dm10010", "rs00",       "rs01",   "rs02",
          "rs03",   "rs04",      "rs05",     "rs06",    "cybergear"};
}

/// Ends of a drive's ranges. A frame holds each number as a share of its range.
struct Ranges {
  double q = 0;     ///< [rad], from -q to q
  double v = 0;     ///< [rad/s], from -v to v
  double tau = 0;   ///< [N m], from -tau to tau
  double kp = 500;  ///< [N m/rad], from 0
  double kd = 5;    ///< [N m s/rad], from 0
};

Family family_of(Model model);
/// Returns the model's ranges; zeros where they come from the scenario.
Ranges ranges_of(Model model);

/// A drive on the bus.
struct Drive {
  Family family = Family::damiao;
  int id = 0;
  int reply_id = 0;  ///< identifier of its answers; RobStride: of the host
  Ranges ranges;
};

/// Set point of one command, in the units of `Ranges`.
struct Setpoint {
  double q = 0, v = 0, kp = 0, kd = 0, tau = 0;
};

/// A drive's answer to a command.
struct Answer {
  double q = 0, v = 0, tau = 0;
  bool enabled = false;
  int fault = 0;           ///< the drive's own code; 0: none
  double temperature = 0;  ///< highest that the drive reports [degrees Celsius]
};

Frame enable(const Drive& drive);
Frame disable(const Drive& drive);
Frame clear_fault(const Drive& drive);
/// Returns the command of one tick. Values beyond a range become its end.
Frame command(const Drive& drive, const Setpoint& setpoint);
/// Returns the command of one tick as above, without the mean errors of its counts: its torque
/// makes up for the rounding of position and velocity, which the gains turn into torque, and what a
/// count of the torque leaves over is added in the next ticks (noise shaping of first order).
/// @param rest what the ticks before left over [N m], 0 at first; the call replaces it
Frame command(const Drive& drive, Setpoint setpoint, double& rest);
/// Returns a request for the position, which changes nothing. Only Damiao's answer also has
/// `Answer::enabled` and the fault.
Frame ask(const Drive& drive);
/// Returns the drive's answer in `frame`; nothing if the frame is not from this drive.
std::optional<Answer> answer_in(const Drive& drive, const Frame& frame);
/// Returns the answer of a drive as a frame, for an emulated drive.
Frame answer_frame(const Drive& drive, const Answer& answer);
/// Returns the set point in a frame of `command`; nothing if the frame is not for this drive.
/// Emulated drives use it.
std::optional<Setpoint> setpoint_in(const Drive& drive, const Frame& frame);

/// Returns a drive's fault in words.
std::string fault_text(Family family, int fault);

/// Registers by their role.
enum class Register { mode, watchdog, q_range, v_range, tau_range };
/// Returns the watchdog's time as both families' registers hold it, in units of 50 us. The unit is
/// documented for RobStride ("20000 is 1 s"); for Damiao it is an assumption.
std::uint32_t watchdog_bits(double seconds);
inline constexpr std::uint32_t mit_mode_damiao = 1, mit_mode_robstride = 0;
Frame read_register(const Drive& drive, Register which);
Frame write_register(const Drive& drive, Register which, std::uint32_t bits);
/// Returns the register's bits in the frame; nothing if the frame is no answer about this register.
/// Read registers before a Damiao drive is enabled, because its answers to commands and to register
/// requests then look alike.
std::optional<std::uint32_t> register_in(const Drive& drive, Register which, const Frame& frame);

}  // namespace tachless::mit_can
