#pragma once

#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>

#include "plant/arm.h"
#include "robot/model.h"

namespace tachless::plant {

/// What an `Arm` delegates to: one implementation per choice of `Mechanics`. Relies on checked
/// sizes and on a time that moves forward, and reports a failure by its cause alone. C++17-clean.
class ArmEngine {
 public:
  ArmEngine() = default;
  ArmEngine(const ArmEngine&) = delete;
  ArmEngine& operator=(const ArmEngine&) = delete;
  virtual ~ArmEngine() = default;

  [[nodiscard]] virtual const ArmState& state() const = 0;
  [[nodiscard]] virtual ArmAcceleration acceleration(const robot::Vector& tau) = 0;
  [[nodiscard]] virtual std::int64_t integrator_steps() const = 0;
  virtual void advance(const robot::Vector& tau, double time_s) = 0;
  virtual void brake(const robot::Vector& damping) = 0;
};

std::unique_ptr<ArmEngine> simbody_arm(const robot::Model& model, const ArmOptions& options,
                                       const ArmState& initial);
std::unique_ptr<ArmEngine> native_arm(const robot::Model& model, const ArmOptions& options,
                                      const ArmState& initial);

/// Integrator steps of one `advance` beyond which it gives up.
inline constexpr int max_steps_per_advance = 20000;
inline std::runtime_error too_many_steps() {
  return std::runtime_error("more than " + std::to_string(max_steps_per_advance) +
                            " integrator steps");
}

}  // namespace tachless::plant
