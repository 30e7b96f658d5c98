#pragma once

#include <memory>

#include "base/quantities.h"
#include "robot/model.h"

namespace tachless::plant {

/// The mechanics of an arm's links, without rotors, springs and friction. The header is valid
/// C++17, because Simbody's translation unit includes it.
class Multibody {
 public:
  Multibody() = default;
  Multibody(const Multibody&) = delete;
  Multibody& operator=(const Multibody&) = delete;
  virtual ~Multibody() = default;

  struct Terms {
    Matrix& M;           ///< inertia matrix; may be overwritten
    const Vector& bias;  ///< C(q,v) v + g(q) [N m; N]
  };
  /// Returns the terms at link position `q` [rad; m] and velocity `v`, valid until the next call.
  virtual Terms evaluate(const Vector& q, const Vector& v) = 0;
};

/// Returns the mechanics by Simbody, as a tree of revolute and prismatic joints.
/// @throw std::exception when Simbody refuses a body's inertia
std::unique_ptr<Multibody> simbody_multibody(const robot::Model& model);

/// Returns the mechanics by the recursions of robot/, which control laws use too. The result
/// allocates nothing after its construction.
std::unique_ptr<Multibody> native_multibody(const robot::Model& model);

}  // namespace tachless::plant
