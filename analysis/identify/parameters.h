#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "robot/model.h"
#include "scenario/scenario.h"

namespace tachless::identify {

/// Kinds of parameters. `inertia`: mass, first moments and inertia of every link. `offset`:
/// constant error of a torque sensor or motor current. `delay`: ticks, with a fraction, from a
/// measurement until the torque computed from it acts. `payload`: mass of a payload whose position
/// is in the scenario. `load`: mass, first moments and inertia of a payload on the scenario's
/// payload link. `rise` and `load_friction`: friction that rises with speed and friction that grows
/// with gravity's torque (`robot::JointFriction`), of the joints of which `FrictionTerm` says so.
enum class Kind {
  rotor,
  viscous,
  coulomb,
  payload,
  delay,
  inertia,
  offset,
  load,
  rise,
  load_friction
};
inline constexpr std::array<std::string_view, 10> kind_names = {
    "rotor",   "viscous", "coulomb", "payload", "delay",
    "inertia", "offset",  "load",    "rise",    "load friction"};
/// Returns whether a kind is a further term of friction, which the data ask for.
constexpr bool is_term(Kind kind) { return kind == Kind::rise || kind == Kind::load_friction; }
/// Number of leading kinds that a user can ask for by name.
inline constexpr std::size_t num_asked_kinds = 7;
/// Number of leading kinds for which a motion can be designed.
inline constexpr std::size_t num_motion_kinds = 4;

/// A rigid body's parameters in which torques are linear: mass [kg], first moments m c (x, y, z)
/// [kg m] and inertia about the origin of its frame (xx, yy, zz, xy, xz, yz) [kg m2].
using Inertial = Eigen::Matrix<double, 10, 1>;
Inertial inertial_of(const robot::MassProperties& body);
/// @param value with a nonzero mass, or with neither mass nor first moments
robot::MassProperties mass_properties(const Inertial& value);

/// One more term of a joint's friction.
struct FrictionTerm {
  Kind kind;  ///< `rise` or `load_friction`
  int joint;
  double velocity = 1;        ///< v_r of a rise [rad/s; m/s]
  bool at_reversals = false;  ///< a rise that rows near reversals tell from Coulomb friction
};

/// The unknown parameters of a robot as one vector: each kind's joints in order, one number for the
/// payload's mass and one for the delay, ten numbers for each body and for the load. A body's
/// numbers are differences to the URDF's values.
class Parameters {
 public:
  struct Entry {
    Kind kind;
    int joint;         ///< -1 for payload, load and delay; for `inertia` the index of the body
    std::string name;  ///< "rotor elbow", "Izz forearm"
    std::string unit;
    bool not_negative = true;
    int component = 0;          ///< index into an `Inertial`
    double velocity = 1;        ///< v_r of a rise
    bool at_reversals = false;  ///< as in `FrictionTerm`
    bool turns = false;         ///< v_r is unknown too
  };

  /// @param controlled the recordings are of the scenario's own law (`Recording::controlled`).
  /// Otherwise a delay is the time by which a table's torques are late. This delay may be negative.
  /// It is a property of the table, so `overrides` does not write it.
  /// @param terms more terms of friction; several rises of a joint are candidates, of which no
  /// plant is made
  Parameters(const scenario::Scenario& scenario, const std::vector<Kind>& unknown,
             bool controlled = true, const std::vector<FrictionTerm>& terms = {});

  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }
  [[nodiscard]] Eigen::Index size() const { return std::ssize(entries_); }

  /// Returns the index of the first entry of a kind, or -1 if there is none.
  [[nodiscard]] Eigen::Index first(Kind kind) const;

  /// Returns the number of rises whose v_r is unknown.
  [[nodiscard]] Eigen::Index num_turning() const;

  /// Makes the v_r of every rise unknown.
  void free_velocities() {
    for (Entry& each : entries_) each.turns = each.kind == Kind::rise;
  }
  /// Returns the v_r that are unknown, in the entries' order.
  [[nodiscard]] Eigen::VectorXd velocities() const;
  /// Sets the v_r that are unknown, in the entries' order.
  void set_velocities(const Eigen::VectorXd& velocities);

  /// Sets the v_r of entry i, a rise.
  /// @param turns v_r is unknown
  void set_velocity(Eigen::Index i, double velocity, bool turns) {
    entries_[static_cast<std::size_t>(i)].velocity = velocity;
    entries_[static_cast<std::size_t>(i)].turns = turns;
  }

  /// Returns `scenario` with these values in its plant, with ideal encoders and with native
  /// mechanics.
  [[nodiscard]] scenario::Scenario plant(const scenario::Scenario& scenario,
                                         const Eigen::VectorXd& values) const;

  /// Returns the values for a run without the load.
  [[nodiscard]] Eigen::VectorXd without_load(Eigen::VectorXd values) const;

  /// Returns overrides such as "plant.drive.coulomb_friction_Nm=[1, 2]" that write the values into
  /// a scenario. Friction is written for the plant and for the law's feedforward. A delay is
  /// rounded to whole ticks. Ticks beyond the scenario's own delay are written as the encoder's
  /// latency. This latency has the same effect in the emulated loop and no effect on a real arm.
  [[nodiscard]] std::vector<std::string> overrides(const scenario::Scenario& scenario,
                                                   const Eigen::VectorXd& values) const;

 private:
  void add_terms_to(std::vector<std::string>& overrides, const scenario::Scenario& scenario,
                    const Eigen::VectorXd& values) const;
  [[nodiscard]] std::vector<double> values_of(Kind kind, const Eigen::VectorXd& values) const;

  std::vector<Entry> entries_;
  bool controlled_;
};

}  // namespace tachless::identify
