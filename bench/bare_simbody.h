#pragma once

#include <memory>

#include "robot/model.h"

/// Simbody as its examples use it: a tree of bodies, gravity, one force per joint, its own
/// Runge-Kutta-Merson. The plant's peer; without mimic joints. C++17-clean.
class BareSimbody {
 public:
  BareSimbody(const tachless::robot::Model& model, double q, double v, double accuracy);
  ~BareSimbody();
  BareSimbody(const BareSimbody&) = delete;
  BareSimbody& operator=(const BareSimbody&) = delete;

  void advance(const tachless::robot::Vector& tau, double time_s);
  /// Position of a joint [rad].
  double q(int joint) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};
