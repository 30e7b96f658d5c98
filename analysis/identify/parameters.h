#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "robot/model.h"
#include "scenario/scenario.h"

namespace tachless::identify {

/// `inertia`: mass, first moments and inertia of every link; `offset`: of what a torque sensor or a
/// motor current says; `delay`: from a measurement until the torque computed from it acts, in ticks
/// and parts of one.
enum class Kind { rotor, viscous, coulomb, payload, delay, inertia, offset };
inline constexpr std::array<std::string_view, 7> kind_names = {
    "rotor", "viscous", "coulomb", "payload", "delay", "inertia", "offset"};
/// The first of them: those that a motion can be chosen for.
inline constexpr std::size_t num_motion_kinds = 4;

/// A rigid body as torques see it, linearly: mass [kg], first moments m c (x, y, z) [kg m] and
/// inertia about the origin of its frame (xx, yy, zz, xy, xz, yz) [kg m2].
using Inertial = Eigen::Matrix<double, 10, 1>;
Inertial inertial_of(const robot::MassProperties& body);
/// @param value with a mass other than zero, or without mass and first moments
robot::MassProperties mass_properties(const Inertial& value);

/// The unknown parameters of a robot as one vector: each kind's joints in order, the payload's mass
/// as one number, ten for each body. Those of a body are counted from what the URDF has, so that
/// zero is the URDF.
class Parameters {
 public:
  struct Entry {
    Kind kind;
    int joint;         ///< -1: the payload, the delay; of `inertia` the index of the body
    std::string name;  ///< "rotor elbow", "Izz forearm"
    std::string unit;
    int component = 0;  ///< of an `Inertial`
  };

  Parameters(const scenario::Scenario& scenario, const std::vector<Kind>& unknown);

  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }
  [[nodiscard]] Eigen::Index size() const { return std::ssize(entries_); }

  /// Number of the first entry of a kind, -1 without.
  [[nodiscard]] Eigen::Index first(Kind kind) const;

  /// The scenario with these values in its plant, ideal encoders and native mechanics.
  [[nodiscard]] scenario::Scenario plant(const scenario::Scenario& scenario,
                                         const Eigen::VectorXd& values) const;

  /// "plant.drive.coulomb_friction_Nm=[1, 2]" …: what writes them into a scenario. Friction is what
  /// the law feeds forward, too. Of a delay the whole ticks: what `scenario` has not in its own
  /// goes to the encoder's latency, which round the loop is the same and is sent to no arm.
  [[nodiscard]] std::vector<std::string> overrides(const scenario::Scenario& scenario,
                                                   const Eigen::VectorXd& values) const;

 private:
  [[nodiscard]] std::vector<double> of(Kind kind, const Eigen::VectorXd& values) const;

  std::vector<Entry> entries_;
};

}  // namespace tachless::identify
