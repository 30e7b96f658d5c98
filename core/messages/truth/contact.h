#pragma once

#include <string>
#include <tuple>

#include "messages/field.h"

namespace tachless::messages::truth {

/// Contact of the simulated robot at the start of a tick: the two geoms with the largest contact
/// force. Only the logger receives this message, in runs with plant.mujoco.
struct Contact {
  std::string simulator;  ///< name and version of the simulator: "MuJoCo 2.2.2"
  std::string geoms;      ///< "tip, wall", the robot's first; empty: no contact
  double force = 0;       ///< [N]

  using Value = Contact;
  static constexpr std::size_t longest_name = 256;
  static constexpr std::string_view type = "tachless_truth.contact_t", suffix = "CONTACT";
  static constexpr auto fields = std::tuple{
      text("simulator", longest_name, &Value::simulator),
      text("geoms", longest_name, &Value::geoms),
      Field<Value, double>{"force", "contact_force", "N", Kind::real, Count::one, &Value::force,
                           "force between the two geoms that press most", 0}};
};

}  // namespace tachless::messages::truth
