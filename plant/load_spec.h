#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "schema/schema.h"

/// What a scenario says about what acts on the plant besides its drives: payload and disturbances.
namespace tachless::plant {

/// What is wrong with a list that has not `size` numbers.
inline schema::Refusal numbers_refusal(std::string_view key, const std::vector<double>& given,
                                       int size) {
  return {std::string(key),
          std::to_string(given.size()) + " numbers; allowed: " + std::to_string(size)};
}

struct PayloadSpec {
  double mass_kg = 0;  ///< known to the plant, not to the controller
  std::string link;    ///< empty: the leaf link that is farthest from the root
  std::vector<double> center_of_mass_m = {0, 0, 0};
  std::vector<double> inertia_kgm2 = {0, 0, 0, 0, 0, 0};

  static constexpr std::tuple keys{
      schema::Key{"mass_kg", &PayloadSpec::mass_kg, "kg",
                  "Mass that the plant has and the controller does not know of"}
          .in(schema::not_negative)
          .by_default(),
      schema::Key{"link", &PayloadSpec::link, "", "URDF link that carries it"}.by_default(
          "the leaf link farthest from the root"),
      schema::Key{"center_of_mass_m", &PayloadSpec::center_of_mass_m, "m",
                  "Its centre of mass, in the link's frame"}
          .by_default("[0, 0, 0]"),
      schema::Key{"inertia_kgm2", &PayloadSpec::inertia_kgm2, "kg m²",
                  "ixx, ixy, ixz, iyy, iyz, izz about its centre of mass, in the link's axes"}
          .by_default("a point mass's")};

  [[nodiscard]] std::optional<schema::Refusal> refusal() const {
    if (center_of_mass_m.size() != 3)
      return numbers_refusal("center_of_mass_m", center_of_mass_m, 3);
    if (inertia_kgm2.size() != 6) return numbers_refusal("inertia_kgm2", inertia_kgm2, 6);
    return {};
  }
};

enum class DisturbanceShape { constant, pulse, sinusoid };
constexpr std::array<std::string_view, 3> names(DisturbanceShape /*type*/) {
  return {"constant", "pulse", "sinusoid"};
}

/// A torque on a joint, or a force on a link, that no drive gives: its value times its shape.
struct DisturbanceSpec {
  std::string joint;                           ///< that the torque acts on; empty: a force
  std::string link;                            ///< that the force acts on; empty: a torque
  std::optional<double> torque_Nm;             ///< of `joint`
  std::optional<std::vector<double>> force_N;  ///< of `link`, in the world
  std::vector<double> point_m = {0, 0, 0};     ///< where the force acts, in the link's frame
  DisturbanceShape shape = DisturbanceShape::constant;
  double start_s = 0;
  std::optional<double> end_s;  ///< nothing: it does not end
  double frequency_hz = 0;
  double phase_rad = 0;

  [[nodiscard]] std::optional<schema::Refusal> refusal() const {
    if (joint.empty() == link.empty()) {
      return schema::Refusal{
          "joint", joint.empty() ? "neither a joint nor a link is given; allowed: one of the two"
                                 : "and a link are given; allowed: one of the two"};
    }
    if (torque_Nm.has_value() == joint.empty()) {
      return schema::Refusal{"torque_Nm", "a joint takes torque_Nm, a link force_N"};
    }
    if (force_N.has_value() == link.empty()) {
      return schema::Refusal{"force_N", "a link takes force_N, a joint torque_Nm"};
    }
    if (force_N && force_N->size() != 3) return numbers_refusal("force_N", *force_N, 3);
    if (point_m.size() != 3) return numbers_refusal("point_m", point_m, 3);
    if (end_s ? *end_s <= start_s : shape == DisturbanceShape::pulse) {
      return schema::Refusal{
          "end_s", end_s ? "not after start_s; allowed: later" : "missing; a pulse needs its end"};
    }
    if ((shape == DisturbanceShape::sinusoid) == (frequency_hz == 0)) {
      return schema::Refusal{"frequency_hz",
                             "a sinusoid has a frequency above 0, others have none"};
    }
    return {};
  }

  static constexpr std::tuple keys{
      schema::Key{"joint", &DisturbanceSpec::joint, "", "Joint that a torque acts on"}.by_default(
          "none: a force"),
      schema::Key{"link", &DisturbanceSpec::link, "", "URDF link that a force acts on"}.by_default(
          "none: a torque"),
      schema::Key{"torque_Nm", &DisturbanceSpec::torque_Nm, "N m (N)", "On `joint`"}.by_default(
          "none"),
      schema::Key{"force_N", &DisturbanceSpec::force_N, "N", "On `link`, [x, y, z] of the world"}
          .by_default("none"),
      schema::Key{"point_m", &DisturbanceSpec::point_m, "m",
                  "Where the force acts, in the link's frame"}
          .by_default("[0, 0, 0]"),
      schema::Key{"shape", &DisturbanceSpec::shape, "",
                  "What the value is multiplied by from `start_s` to `end_s`: 1; half a sine wave "
                  "from start to end; sin(2π frequency (t - start) + phase)"}
          .by_default(),
      schema::Key{"start_s", &DisturbanceSpec::start_s, "s", "Nothing before"}
          .in(schema::not_negative)
          .by_default(),
      schema::Key{"end_s", &DisturbanceSpec::end_s, "s", "Nothing from then on; a pulse needs it"}
          .in(schema::positive)
          .by_default("never"),
      schema::Key{"frequency_hz", &DisturbanceSpec::frequency_hz, "Hz", "Of a sinusoid"}
          .in(schema::not_negative)
          .by_default(),
      schema::Key{"phase_rad", &DisturbanceSpec::phase_rad, "rad", "Of a sinusoid"}.by_default()};
};

}  // namespace tachless::plant
