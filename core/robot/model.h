#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/quantities.h"

namespace tachless::robot {

/// Kind of a coordinate: an angle [rad] or a length [m].
enum class JointType { revolute, prismatic };

/// Most moving bodies a model may have: mimic joints move bodies without adding coordinates.
inline constexpr int max_bodies = 2 * max_joints;

/// Mass, centre of mass and inertia of a rigid body, in one frame, B.
struct MassProperties {
  double mass = 0;                                  ///< [kg]
  Eigen::Vector3d p_Bcm = Eigen::Vector3d::Zero();  ///< centre of mass [m]
  Eigen::Matrix3d I_Bcm = Eigen::Matrix3d::Zero();  ///< about the centre of mass [kg m2]
};

/// Returns the properties of two rigid bodies together, all in one frame. Inertia without mass
/// counts too.
MassProperties combine(const MassProperties& a, const MassProperties& b);

/// Returns R I R', symmetric, and exactly I for R = 1.
Eigen::Matrix3d rotated(const Eigen::Matrix3d& I, const Eigen::Matrix3d& R);

/// Returns why no rigid body can have these properties, with value and remedy; empty if one can.
/// For rounding in printed URDFs, 1e-6 of the largest principal moment and a radius of gyration of
/// 1e-6 m are allowed.
std::string why_not_physical(const MassProperties& body);

/// One moving body of the tree, in its own frame: everything fixed to it is merged in. Bodies are
/// ordered so that a parent comes before its children.
struct Body : MassProperties {
  std::string link;                      ///< URDF link that moves with the joint
  std::string joint;                     ///< URDF joint that moves it
  int parent = -1;                       ///< index into `Model::bodies`; -1 is the ground
  JointType type = JointType::revolute;  ///< kind of the body's coordinate
  Eigen::Matrix3d R_PB =
      Eigen::Matrix3d::Identity();  ///< body frame in the parent's at joint angle 0
  /// Origin of the body frame in the parent's frame [m].
  Eigen::Vector3d p_PB = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis_B = Eigen::Vector3d::UnitZ();  ///< unit, in the body frame
  /// q_tree = multiplier q[coordinate] + offset; a `mimic` joint shares another's coordinate.
  int coordinate = 0;
  double multiplier = 1;  ///< factor of the shared coordinate
  double offset = 0;      ///< [rad; m]
};

/// Place of a URDF link after fixed joints are merged.
struct Frame {
  int body = -1;  ///< -1 is the ground
  /// Axes of the link's frame in the body's frame.
  Eigen::Matrix3d R_BF = Eigen::Matrix3d::Identity();
  Eigen::Vector3d p_BF = Eigen::Vector3d::Zero();  ///< its origin there [m]
  bool leaf = false;  ///< the link is the parent of no joint, not even of a fixed one
};

/// A robot: a tree of revolute and prismatic joints. Some joints may mimic others.
struct Model {
  /// Value of a limit that a joint does not have.
  static constexpr double unlimited = std::numeric_limits<double>::infinity();

  int num_joints = 0;                    ///< independent coordinates
  std::vector<Body> bodies;              ///< parents before children
  std::map<std::string, Frame> frames;   ///< by URDF link name
  std::vector<std::string> joint_names;  ///< by coordinate
  std::vector<JointType> joint_types;    ///< by coordinate
  Vector lower;                          ///< [rad; m], -unlimited where the URDF has none
  Vector upper;                          ///< [rad; m], unlimited where the URDF has none
  Vector effort_limit;                   ///< [N m; N], unlimited where none (or 0) is given
  Vector velocity_limit;                 ///< [rad/s; m/s]
  Vector deceleration_limit;  ///< of `speed_limit` [rad/s2; m/s2], unlimited: none; empty: none
  Vector velocity_offset;     ///< of `speed_limit` [rad/s; m/s], where that one is limited
  Eigen::Vector3d gravity = {0, 0, -9.81};  ///< in the world [m/s2]
  Vector
      rotor_inertia;  ///< added to the diagonal of M [kg m2], of the URDF's armature; empty: zero
  Vector damping;     ///< viscous, of the URDF's dynamics [N m s/rad; N s/m]
  Vector friction;    ///< Coulomb's, of the URDF's dynamics [N m; N]
  std::vector<std::string> warnings;  ///< dubious places of the URDF
};

/// Labels of the joints' values: names in the URDF, units of positions and of efforts.
struct JointLabels {
  std::vector<std::string> name;    ///< in the URDF
  std::vector<std::string> length;  ///< "rad" or "m"
  std::vector<std::string> effort;  ///< "N m" or "N"

  /// Returns e.g. "joint 2 (elbow)" for i = 1.
  [[nodiscard]] std::string joint(std::size_t i) const;
};
/// Returns the labels of all joints.
JointLabels joint_labels(const Model& model);

/// Returns the limit of |v| of a joint that is at `q` and moves with a velocity of the sign of `v`
/// [rad/s; m/s]: the `velocity_limit`, and at a distance d from the end of the range that the joint
/// moves to, sqrt(2 a d) - v0 if that is less, at least 0. The deceleration a and the offset v0 are
/// those of the URDF's position_based_velocity_limits, an element of the descriptions of Franka's
/// arms.
double speed_limit(const Model& model, Eigen::Index joint, double q, double v);

/// Returns the posture with each joint as near to 0 as its range allows.
Vector nearest_to_zero(const Model& model);

/// Returns a joint's range. A side without a limit ends half a turn, or 1 m, from the position
/// nearest to 0.
std::pair<double, double> finite_range(const Model& model, int joint);

/// Treatment of a moving body with a physically impossible inertia.
enum class CheckInertia { refuse, warn };
/// Returns the names of the choices in scenarios.
constexpr std::array<std::string_view, 2> names(CheckInertia /*type*/) {
  return {"refuse", "warn"};
}

/// Options of reading a URDF.
struct UrdfOptions {
  /// Treatment of a body with an impossible inertia.
  CheckInertia check_inertia = CheckInertia::refuse;
  std::map<std::string, double> locked;  ///< joints fixed at a position [rad; m]; no coordinates
  /// Roll, pitch, yaw of the root link in the world [rad].
  Eigen::Vector3d base_rpy = Eigen::Vector3d::Zero();
  Eigen::Vector3d base_xyz = Eigen::Vector3d::Zero();  ///< its origin there [m]
};

/// Returns the part of a URDF's text that is read: names, joints, limits and inertials, each number
/// as written. Visuals, collisions, comments and unknown elements are left out. Reading the result
/// gives the same model.
/// @throw std::invalid_argument as `model_from_urdf`, for errors that the XML alone shows
std::string urdf_mechanics(const std::string& text, const std::string& source);

/// Reads a URDF text: revolute, continuous, prismatic and fixed joints, `mimic`. The root link is
/// fixed to the ground. `source` is the file name for messages.
///
/// Coordinates and bodies are numbered depth-first from the root, the children of a link in the
/// order of their joints in the file. A mimic joint adds a body, not a coordinate. Its limits are
/// not read. Its damping and friction are added to the joint that drives it. Links behind fixed and
/// locked joints are merged into the body that carries them. The inertia of the merged body is
/// checked, unless it is fixed to the ground. An effort or velocity limit of 0 or below means none.
/// Visuals, collisions, safety controllers and transmissions are not read. The inertia matrix is
/// not checked.
/// @throw std::invalid_argument in one line naming source, link or joint, value and remedy
/// @throw std::invalid_argument for XML or URDF that does not parse, remains of xacro, duplicated
/// or unknown names
/// @throw std::invalid_argument for links that are no tree, joints of other types, a mimic cycle,
/// an axis of zero length, a lower limit that is not below the upper one, and more than
/// `max_joints` coordinates or `max_bodies` bodies
/// @throw std::invalid_argument for impossible inertias, which are named all at once, unless
/// `check_inertia` is `warn`
Model read_urdf(const std::string& text, const std::string& source,
                const UrdfOptions& options = {});

/// Returns whether every body's inertia is physically possible.
bool is_possible(const Model& model);

/// Returns the joints at which the inertia matrix is not positive definite: a pivot is not above
/// rounding of its diagonal entry. Examines the posture nearest to 0 and 8 others in the joints'
/// range, 1000 if a body's inertia is impossible.
std::vector<std::string> joints_without_inertia(const Model& model);

/// Refuses a model with `joints_without_inertia`: links without mass cause them.
/// @throw std::invalid_argument in one line
void require_positive_inertia(const Model& model, const std::string& source);

/// Calls `read_urdf`, then `require_positive_inertia`.
inline Model model_from_urdf(const std::string& text, const std::string& source,
                             const UrdfOptions& options = {}) {
  Model model = read_urdf(text, source, options);
  require_positive_inertia(model, source);
  return model;
}

/// Returns the leaf links farthest from the root. Usually this is one link, which carries the tool.
/// The number of moving joints decides first, then the length along the joints' origins at q = 0.
/// If several links are at one place, the first by name is returned. Links at different places,
/// such as fingers, are all returned.
std::vector<std::string> farthest_leaves(const Model& model);

/// Returns the model with a payload fixed to `link` and given in the link's frame. Without `link`,
/// it is the only link of `farthest_leaves`.
/// @throw std::invalid_argument for a mass that is negative or not finite, an unknown link, a link
/// that does not move, or an ambiguous default.
Model with_payload(Model model, const MassProperties& payload, const std::string& link = {});

}  // namespace tachless::robot
