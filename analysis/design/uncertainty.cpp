#include "design/uncertainty.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "base/failure.h"
#include "base/text.h"

namespace tachless::design {
namespace {

// Draws from the inside of the uncertain set. The corners move all inertias together; the draws
// move each inertia by itself.
constexpr int plants_inside = 8;

/// Returns a number from -1 to 1: term `k` of a sequence that fills the interval evenly.
double spread(int k, std::size_t dimension) {
  constexpr double golden = 0.6180339887498949;
  return 2 * std::fmod(k * golden * static_cast<double>(dimension + 1), 1.0) - 1;
}

void scale(robot::Body& body, double factor) {
  body.mass *= factor;
  body.I_Bcm *= factor;
}

/// Returns the model with each link and rotor at a place of its range, -1 to 1.
/// @param link_at, rotor_at return the place
template <class LinkAt, class RotorAt>
robot::Model changed(robot::Model model, const Uncertainty& by, const LinkAt& link_at,
                     const RotorAt& rotor_at) {
  for (std::size_t i = 0; i < model.bodies.size(); ++i) {
    scale(model.bodies[i], 1 + by.links * link_at(i));
  }
  if (model.rotor_inertia.size() == 0) model.rotor_inertia = Vector::Zero(model.num_joints);
  for (Eigen::Index j = 0; j < model.rotor_inertia.size(); ++j) {
    const double place = rotor_at(static_cast<std::size_t>(j));
    double& inertia = model.rotor_inertia[j];
    const double width =
        by.rotors_kgm2.size() == 0 ? 0 : by.rotors_kgm2[by.rotors_kgm2.size() == 1 ? 0 : j];
    inertia = std::max(0.0, inertia * (1 + by.rotors * place) + width * place);
  }
  return model;
}

std::string name_of(const std::string& masses, int delay) {
  const std::string ticks =
      delay == 0 ? "" : fmt::format("{} more {} of delay", delay, delay == 1 ? "tick" : "ticks");
  if (masses.empty() || ticks.empty()) return masses + ticks;
  return masses + ", " + ticks;
}

/// Reads "0.05", or "0.05/0.02/0.01" with a number for each joint. Returns nothing if the text is
/// neither.
Vector inertias_in(std::string_view text) {
  constexpr double most = 1e3;  // [kg m2]
  const std::vector<std::string_view> parts = base::split(text, '/');
  if (parts.size() > static_cast<std::size_t>(max_joints)) return {};
  Vector all(std::ssize(parts));
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const double number = base::number_in(parts[i]).value_or(NAN);
    if (!(number >= 0 && number <= most)) return {};
    all[static_cast<Eigen::Index>(i)] = number;
  }
  return all;
}

}  // namespace

Uncertainty parse_uncertainty(std::string_view text) {
  Uncertainty result;
  for (const std::string_view part : base::split(text, ',')) {
    const std::size_t equals = part.find('=');
    std::string_view name = part.substr(0, equals), value;
    if (equals != std::string_view::npos) value = part.substr(equals + 1);
    const bool percent = value.ends_with('%');
    if (percent) value.remove_suffix(1);
    const double number = base::number_in(std::string(value)).value_or(NAN);
    const auto is = [&](std::string_view wanted, double most, bool in_percent) {
      return name == wanted && percent == in_percent && number >= 0 && number <= most;
    };
    if (is("links", 90, true)) {
      result.links = number / 100;
    } else if (is("rotors", 90, true)) {
      result.rotors = number / 100;
    } else if (name == "rotors" && !percent && inertias_in(value).size() > 0) {
      result.rotors_kgm2 = inertias_in(value);
    } else if (is("delay", 100, false) && number == std::floor(number)) {
      result.delay = static_cast<int>(number);
    } else {
      throw base::bad_usage(
          "--uncertain {}: {}; allowed: links=P%, rotors=P% or rotors=KG_M2 (with a / between the "
          "numbers of the joints), delay=TICKS, with P up to 90, separated by commas, as in "
          "links=20%,rotors=30%,delay=1",
          text, part);
    }
  }
  return result;
}

std::vector<UncertainPlant> uncertain_plants(const robot::Model& nominal,
                                             const Uncertainty& uncertainty) {
  std::vector<UncertainPlant> all;
  const Vector& rotors_kgm2 = uncertainty.rotors_kgm2;
  if (rotors_kgm2.size() > 1 && rotors_kgm2.size() != nominal.num_joints) {
    throw base::bad_usage(
        "--uncertain rotors=…: {} numbers for {} joints; give one, or one for each joint",
        rotors_kgm2.size(), nominal.num_joints);
  }
  const bool masses =
      uncertainty.links > 0 || uncertainty.rotors > 0 || (rotors_kgm2.array() > 0).any();
  const auto add = [&](robot::Model model, int delay, const std::string& name) {
    all.push_back({std::move(model), delay, name_of(name, delay)});
  };
  const auto corner = [&](double place) {
    const auto at = [place](std::size_t) { return place; };
    return changed(nominal, uncertainty, at, at);
  };
  for (const int delay : {0, uncertainty.delay}) {
    if (masses) {
      add(corner(1), delay, "all inertias at their largest");
      add(corner(-1), delay, "all inertias at their least");
    } else if (delay > 0) {
      add(nominal, delay, "");
    }
    if (uncertainty.delay == 0) break;
  }
  for (int k = 1; masses && k <= plants_inside; ++k) {
    const std::size_t links = nominal.bodies.size();
    add(changed(
            nominal, uncertainty, [k](std::size_t i) { return spread(k, i); },
            [k, links](std::size_t j) { return spread(k, links + j); }),
        k % 2 == 0 ? uncertainty.delay : 0, fmt::format("inertias of draw {}", k));
  }
  return all;
}

}  // namespace tachless::design
