#include "experiment/scenario_keys.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>
#include <stdexcept>

namespace tachless::experiment {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr Range positive{0, infinity, true, false};
constexpr Range not_negative{0, infinity, false, false};

std::string shortest(double value) {
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, value).ptr;
  return {text, end};
}

std::string without_indices(std::string_view path) {
  std::string plain;
  bool inside = false;
  for (const char c : path) {
    if (c == '[') inside = true;
    if (!inside) plain += c;
    if (c == ']') inside = false;
  }
  return plain;
}

bool is_below(std::string_view path, std::string_view map) {
  return path.size() > map.size() && path.substr(0, map.size()) == map && path[map.size()] == '.';
}

std::string_view last_name(std::string_view path) { return path.substr(path.rfind('.') + 1); }

std::string_view parent(std::string_view path) {
  const std::size_t dot = path.rfind('.');
  return dot == std::string_view::npos ? std::string_view{} : path.substr(0, dot);
}

/// "controller.gains.<name>" stands for "controller.gains.kp".
bool stands_for(std::string_view pattern, std::string_view path) {
  return last_name(pattern) == "<name>" && parent(pattern) == parent(path);
}

int edit_distance(std::string_view a, std::string_view b) {
  std::vector<int> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    int diagonal = row[0];
    row[0] = static_cast<int>(i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const int replaced = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, replaced});
    }
  }
  return row.back();
}

}  // namespace

const std::vector<Key>& scenario_keys() {
  using enum Shape;
  // Range: {min, max, min is excluded, max is excluded}.
  static const std::vector<Key> keys = {
      {"name",
       text,
       "",
       "",
       {},
       {},
       false,
       "Name of the experiment: letters, digits, `.`, `_`, `-`, at most 100"},

      {"robot.name",
       text,
       "",
       "arm",
       {},
       {},
       false,
       "Prefix of the channels, in upper case: letters, digits, `_`, at most 32"},
      {"robot.urdf",
       text,
       "",
       "",
       {},
       {},
       false,
       "URDF file, absolute or relative to the scenario's file"},
      {"robot.gravity_m_per_s2",
       number,
       "m/s²",
       "9.81",
       {0, 1000},
       {},
       false,
       "Along -z of the URDF's root link"},
      {"robot.joints",
       choice_or_map,
       "",
       "rigid",
       {},
       {"rigid", "flexible"},
       false,
       "Motors fixed to their joints, or behind springs"},
      {"robot.joints.rigid.rotor_inertia_kgm2",
       joints,
       "kg m²",
       "0",
       not_negative,
       {},
       false,
       "Added to the diagonal of M, on the link side of the gear"},
      {"robot.joints.flexible.stiffness_Nm_per_rad",
       joints,
       "N m/rad",
       "",
       positive,
       {},
       false,
       "Spring between motor and link"},
      {"robot.joints.flexible.rotor_inertia_kgm2",
       joints,
       "kg m²",
       "",
       positive,
       {},
       false,
       "Rotor J, on the link side of the gear"},
      {"robot.joints.flexible.motor_damping_Nms_per_rad",
       joints,
       "N m s/rad",
       "0",
       not_negative,
       {},
       false,
       "Viscous damping of the motor"},

      {"plant.initial.position_rad",
       joints,
       "rad (m)",
       "0",
       {},
       {},
       false,
       "Link position, within the URDF's limits"},
      {"plant.initial.velocity_rad_per_s",
       joints,
       "rad/s (m/s)",
       "0",
       {},
       {},
       false,
       "Link velocity"},
      {"plant.initial.motor_position_rad",
       joints,
       "rad",
       "(static balance)",
       {},
       {},
       false,
       "Motor position, flexible joints only"},
      {"plant.initial.motor_velocity_rad_per_s",
       joints,
       "rad/s",
       "(at rest)",
       {},
       {},
       false,
       "Motor velocity, flexible joints only"},
      {"plant.integrator.method",
       choice,
       "",
       "runge_kutta_merson",
       {},
       {"runge_kutta_merson", "runge_kutta_3", "runge_kutta_feldberg", "semi_explicit_euler_2",
        "verlet", "cpodes"},
       false,
       "Simbody's integrator"},
      {"plant.integrator.accuracy",
       number,
       "",
       "1.0e-9",
       {1e-14, 1e-1},
       {},
       false,
       "Relative accuracy of the integrator"},
      {"plant.encoder.resolution_bits",
       whole,
       "bit",
       "null",
       {1, 52},
       {},
       true,
       "2^bits counts per revolution; null = ideal"},
      {"plant.encoder.noise_std_rad",
       number,
       "rad (m)",
       "0",
       not_negative,
       {},
       false,
       "Gaussian noise on positions, before quantisation"},
      {"plant.encoder.velocity_noise_std_rad_per_s",
       number,
       "rad/s (m/s)",
       "0",
       not_negative,
       {},
       false,
       "Gaussian noise on velocities, for the laws that measure them"},
      {"plant.encoder.seed",
       whole,
       "",
       "1",
       {0, 9007199254740992.0},
       {},
       false,
       "Of the noise: the same seed gives the same run"},
      {"plant.encoder.side",
       choice,
       "",
       "both",
       {},
       {"link", "motor", "both"},
       false,
       "Where encoders are; `motor` needs flexible joints"},
      {"plant.drive.torque_limit_Nm",
       joints,
       "N m (N)",
       "(effort limits of the URDF)",
       positive,
       {},
       true,
       "Largest torque of the drive; null = none"},
      {"plant.drive.viscous_friction_Nms_per_rad",
       joints,
       "N m s/rad",
       "0",
       not_negative,
       {},
       false,
       "On the links' joints"},
      {"plant.payload.mass_kg",
       number,
       "kg",
       "0",
       not_negative,
       {},
       false,
       "Point mass that the plant has and the controller does not know of"},
      {"plant.payload.link",
       text,
       "",
       "(the leaf link farthest from the root)",
       {},
       {},
       false,
       "URDF link that carries it, at its origin"},

      {"reference.hold.position_rad", joints, "rad (m)", "", {}, {}, false, "Constant reference"},
      {"reference.sinusoid.amplitude_rad",
       joints,
       "rad (m)",
       "",
       {},
       {},
       false,
       "offset + amplitude sin(2π frequency t + phase)"},
      {"reference.sinusoid.frequency_hz", joints, "Hz", "", not_negative, {}, false, "Frequency"},
      {"reference.sinusoid.phase_rad", joints, "rad", "0", {}, {}, false, "Phase at t = 0"},
      {"reference.sinusoid.offset_rad", joints, "rad (m)", "0", {}, {}, false, "Middle"},
      {"reference.multi_sine.offset_rad",
       joints,
       "rad (m)",
       "0",
       {},
       {},
       false,
       "offset + sum of sinusoids"},
      {"reference.multi_sine.terms", list_of_maps, "", "", {}, {}, false, "One map per sinusoid"},
      {"reference.multi_sine.terms.amplitude_rad",
       joints,
       "rad (m)",
       "",
       {},
       {},
       false,
       "Amplitude"},
      {"reference.multi_sine.terms.frequency_hz",
       joints,
       "Hz",
       "",
       not_negative,
       {},
       false,
       "Frequency"},
      {"reference.multi_sine.terms.phase_rad", joints, "rad", "0", {}, {}, false, "Phase at t = 0"},
      {"reference.point_to_point.from_rad",
       joints,
       "rad (m)",
       "",
       {},
       {},
       false,
       "Degree-9 polynomial, at rest through snap at both ends"},
      {"reference.point_to_point.to_rad",
       joints,
       "rad (m)",
       "",
       {},
       {},
       false,
       "End of the motion"},
      {"reference.point_to_point.start_s",
       number,
       "s",
       "0",
       not_negative,
       {},
       false,
       "Until then at `from_rad`"},
      {"reference.point_to_point.duration_s",
       number,
       "s",
       "1",
       positive,
       {},
       false,
       "Of the motion; after it at `to_rad`"},
      {"reference.waypoints.time_s",
       numbers,
       "s",
       "",
       not_negative,
       {},
       false,
       "At least two, increasing: C4 spline, at rest at both ends"},
      {"reference.waypoints.position_rad",
       joints_list,
       "rad (m)",
       "",
       {},
       {},
       false,
       "One entry per time"},

      {"controller.law",
       text,
       "",
       "",
       {},
       {},
       false,
       "Name of the control law: lower-case letters, digits, `_`"},
      {"controller.gains.<name>",
       joints,
       "",
       "",
       {},
       {},
       false,
       "The law's gains by name; which ones, with units and ranges, the law says"},
      {"controller.filter",
       choice,
       "",
       "first_order_hold",
       {},
       {"first_order_hold", "tustin", "backward_euler", "zero_order_hold"},
       false,
       "How the filter b p/(p + a) is discretised"},
      {"controller.filter_start",
       choice,
       "",
       "at_error",
       {},
       {"at_error", "zero"},
       false,
       "`at_error`: w(0) = e(0), so nu(0) = 0; `zero`: w(0) = 0, kicks with Kd B e(0)"},
      {"controller.feedforward_lead",
       choice,
       "",
       "none",
       {},
       {"none", "half_tick_plus_delay"},
       false,
       "Evaluates the feed-forward ahead by the mean age of a held torque"},

      {"loop.mode",
       choice,
       "",
       "lockstep",
       {},
       {"lockstep", "realtime"},
       false,
       "Simulation time as fast as it goes, or wall-clock time"},
      {"loop.period_s", number, "s", "1.0e-3", {0, 1, true, false}, {}, false, "One tick, h"},
      {"loop.duration_s",
       number,
       "s",
       "1",
       positive,
       {},
       false,
       "A whole number of periods, at most 1e9"},
      {"loop.command_delay",
       whole,
       "ticks",
       "(0 in lockstep, 1 in realtime)",
       {0, 1},
       {},
       false,
       "The torque computed from tick k acts over tick k + delay"},
      {"loop.max_missed",
       whole,
       "ticks",
       "20",
       {0, 1e6},
       {},
       false,
       "Realtime: commands missed in a row before the protective stop"},
      {"loop.give_up_s",
       number,
       "s",
       "5",
       {0, 3600, true, false},
       {},
       false,
       "A peer silent for this long is lost"},
  };
  return keys;
}

bool Range::contains(double value) const {
  return std::isfinite(value) && (min_open ? value > min : value >= min) &&
         (max_open ? value < max : value <= max);
}

std::string Range::text() const {
  const bool bounded_below = std::isfinite(min);
  const bool bounded_above = std::isfinite(max);
  if (bounded_below && bounded_above) {
    return (min_open ? "in (" : "in [") + shortest(min) + ", " + shortest(max) +
           (max_open ? ")" : "]");
  }
  if (bounded_below) return (min_open ? "> " : ">= ") + shortest(min);
  if (bounded_above) return (max_open ? "< " : "<= ") + shortest(max);
  return "";
}

const Key& scenario_key(std::string_view path) {
  const std::string plain = without_indices(path);
  for (const Key& key : scenario_keys()) {
    if (key.path == plain || stands_for(key.path, plain)) return key;
  }
  throw std::logic_error("scenario key " + plain + " is not declared");
}

bool is_scenario_key(std::string_view path) {
  const std::string plain = without_indices(path);
  return std::any_of(scenario_keys().begin(), scenario_keys().end(), [&](const Key& key) {
    return key.path == plain || is_below(key.path, plain) || stands_for(key.path, plain);
  });
}

bool has_keys_below(std::string_view path) {
  const std::string plain = without_indices(path);
  return std::any_of(scenario_keys().begin(), scenario_keys().end(),
                     [&](const Key& key) { return is_below(key.path, plain); });
}

std::string allowed_text(const Key& key) {
  const std::string range = key.range.text();
  const std::string each = range.empty() ? "" : ", each " + range;
  std::string allowed;
  switch (key.shape) {
    case Shape::text:
      allowed = "text";
      break;
    case Shape::choice:
      allowed = "one of";
      for (const std::string_view choice : key.choices) {
        allowed += (choice == key.choices.front() ? " " : ", ") + std::string(choice);
      }
      break;
    case Shape::number:
      allowed = "a finite number" + (range.empty() ? "" : " " + range);
      break;
    case Shape::whole:
      allowed = "a whole number" + (range.empty() ? "" : " " + range);
      break;
    case Shape::joints:
      allowed = "a finite number, or a list with one per joint" + each;
      break;
    case Shape::numbers:
      allowed = "a list of finite numbers" + each;
      break;
    case Shape::joints_list:
      allowed = "a list whose entries are a finite number or a list with one per joint";
      break;
    case Shape::choice_or_map:
      allowed = "rigid, or a map with exactly one of rigid, flexible";
      break;
    case Shape::list_of_maps:
      allowed = "a list of maps, at least one";
      break;
  }
  return key.nullable ? allowed + "; or null" : allowed;
}

std::string nearest_scenario_key(std::string_view path) {
  const std::string plain = without_indices(path);
  std::string nearest;
  int least = std::numeric_limits<int>::max();
  const auto consider = [&](std::string_view candidate) {
    // A misspelt name in its right place is likelier than a right name in a wrong place.
    const int distance = 2 * edit_distance(last_name(plain), last_name(candidate)) +
                         (parent(plain) == parent(candidate) ? 0 : 3);
    if (distance < least) {
      least = distance;
      nearest = candidate;
    }
  };
  for (const Key& key : scenario_keys()) {
    for (std::string_view part = key.path; !part.empty(); part = parent(part)) {
      if (last_name(part) != "<name>") consider(part);
    }
  }
  return nearest;
}

std::string scenario_key_table() {
  std::string table =
      "| key | unit | default | allowed | meaning |\n"
      "|---|---|---|---|---|\n";
  for (const Key& key : scenario_keys()) {
    const std::string fallback(key.fallback);
    table += "| `" + std::string(key.path) + "` | " + std::string(key.unit) + " | " +
             (fallback.empty()          ? "**required**"
              : fallback.front() == '(' ? fallback.substr(1, fallback.size() - 2)
                                        : "`" + fallback + "`") +
             " | " + allowed_text(key) + " | " + std::string(key.meaning) + " |\n";
  }
  return table;
}

}  // namespace tachless::experiment
