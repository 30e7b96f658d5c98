#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/quantities.h"
#include "robot/model.h"

namespace tachless::design {

/// Bounds of the differences between the plant and the law's model.
struct Uncertainty {
  double links = 0;    ///< share by which mass and inertia of each link may differ
  double rotors = 0;   ///< share by which the inertia of each rotor may differ
  Vector rotors_kgm2;  ///< inertia by which rotors may differ: one for all, or one a joint [kg m2]
  int delay = 0;       ///< further ticks of delay
};

/// Reads e.g. "links=20%,rotors=0.05,delay=1". A percentage of the rotors is a share of their
/// inertia, a number is an inertia [kg m2]. Numbers for each joint are separated by slashes.
/// @throw base::Failure(bad_usage) naming the text, the part and what is allowed
Uncertainty parse_uncertainty(std::string_view text);

/// One plant of the set.
struct UncertainPlant {
  robot::Model model;
  int more_delay = 0;
  std::string name;  ///< e.g. "links +20 %, 1 more tick"
};

/// Returns plants of the set, the same in each call. At the corners of the set all links and rotors
/// are heavy or all are light, each without and with the delay. Eight more plants are inside the
/// set; each of their links and rotors differs by its own number.
/// @throw base::Failure(bad_usage) if there are neither one nor `num_joints` inertias of rotors
std::vector<UncertainPlant> uncertain_plants(const robot::Model& nominal,
                                             const Uncertainty& uncertainty);

}  // namespace tachless::design
