#pragma once

// Names of ur_client_library that the driver uses, over an arm that is emulated in this process.
// Each data package is a tick of 2 ms of the arm's own time.

#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "base/quantities.h"
#include "robot/model.h"
#include "scenario/scenario.h"

namespace urcl {

using vector3d_t = std::array<double, 3>;
using vector6d_t = std::array<double, 6>;

/// The arm that the next UrDriver connects to, and its troubles.
class EmulatedArm {
 public:
  explicit EmulatedArm(const tachless::scenario::Scenario& scenario);
  EmulatedArm(const EmulatedArm&) = delete;
  EmulatedArm& operator=(const EmulatedArm&) = delete;
  ~EmulatedArm();

  // Troubles.
  std::string version = "5.25.1";
  bool is_there = true, program_starts = true, takes_friction_scales = true;
  std::int64_t protective_stop_at = -1, silent_from = -1, program_ends_at = -1;  ///< torques

  // The client's requests.
  vector6d_t viscous_scale{}, coulomb_scale{};
  float payload_kg = -1;
  int stops = 0;

  /// Lets a tick pass: the torque of the tick before acts, and the program ends without commands.
  void tick();
  void command(const vector6d_t& tau, std::chrono::milliseconds timeout);
  void end_program();
  [[nodiscard]] bool is_silent() const { return silent_from >= 0 && torques_ >= silent_from; }

  tachless::Vector q, v;
  double time_s = 100;
  std::int32_t safety = 1;
  bool program_runs = false;
  std::function<void(bool)> on_program;

 private:
  tachless::robot::Model model_;
  tachless::Vector next_, acting_;
  bool torque_mode_ = false;
  std::int64_t torques_ = 0;
  double heard_s_ = 0, timeout_s_ = 0;
};

struct VersionInformation {
  std::uint32_t major = 0, minor = 0, bugfix = 0;
  static VersionInformation fromString(const std::string& text);
  friend auto operator<=>(const VersionInformation&, const VersionInformation&) = default;
};

class RobotReceiveTimeout {
 public:
  static RobotReceiveTimeout millisec(unsigned milliseconds) {
    return RobotReceiveTimeout{std::chrono::milliseconds(milliseconds)};
  }
  std::chrono::milliseconds timeout;
};

namespace comm {
enum class ControlMode { MODE_STOPPED = -2, MODE_TORQUE = 8 };
}  // namespace comm

namespace rtde_interface {
class DataPackage {
 public:
  explicit DataPackage(const std::vector<std::string>& recipe) : recipe_(recipe) {}
  bool getData(const std::string& name, vector6d_t& value) const;
  bool getData(const std::string& name, double& value) const;
  bool getData(const std::string& name, std::int32_t& value) const;
  const EmulatedArm* arm = nullptr;

 private:
  /// @throw std::runtime_error if `name` was not asked for
  void require(const std::string& name) const;
  std::vector<std::string> recipe_;
};
}  // namespace rtde_interface

struct UrDriverConfiguration {
  std::string robot_ip, script_file;
  std::vector<std::string> output_recipe, input_recipe;
  std::function<void(bool)> handle_program_state;
  bool headless_mode = false;
  std::string reverse_ip;
};

class UrDriver {
 public:
  /// @throw std::runtime_error if there is no arm
  explicit UrDriver(const UrDriverConfiguration& config);
  VersionInformation getVersion() const;
  std::vector<std::string> getRTDEOutputRecipe() const { return recipe_; }
  void startRTDECommunication() {}
  bool getDataPackage(rtde_interface::DataPackage& package);
  bool writeJointCommand(const vector6d_t& values, comm::ControlMode mode,
                         const RobotReceiveTimeout& timeout);
  bool setFrictionScales(const vector6d_t& viscous, const vector6d_t& coulomb);
  bool setTargetPayload(float mass, const vector3d_t& center);
  bool stopControl();

 private:
  EmulatedArm& arm_;
  std::vector<std::string> recipe_;
};

}  // namespace urcl
