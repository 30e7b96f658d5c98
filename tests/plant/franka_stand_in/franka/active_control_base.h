#pragma once

// Names of libfranka's franka/active_control_base.h and control_types.h that the driver uses.

#include <array>

namespace franka {

enum class RealtimeConfig { kEnforce, kIgnore };

class Torques {
 public:
  Torques(const std::array<double, 7>& torques) noexcept : tau_J(torques) {}
  std::array<double, 7> tau_J;
};

class ActiveControlBase {
 public:
  virtual ~ActiveControlBase() = default;
  virtual void writeOnce(const Torques& torques) = 0;
};

}  // namespace franka
