#pragma once

#include <Eigen/Core>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "robot/quantities.h"

namespace tachless::robot {

enum class JointType { revolute, prismatic };

/// Most moving bodies a model may have: mimic joints move bodies without adding coordinates.
inline constexpr int max_bodies = 2 * max_joints;

/// One moving body of the tree: everything fixed to it is merged in. Bodies are ordered so that
/// a parent comes before its children.
struct Body {
  std::string link;   ///< URDF link that moves with the joint
  std::string joint;  ///< URDF joint that moves it
  int parent = -1;    ///< index into `Model::bodies`; -1 is the ground
  JointType type = JointType::revolute;
  Eigen::Matrix3d R_PB =
      Eigen::Matrix3d::Identity();                 ///< body frame in the parent's at joint angle 0
  Eigen::Vector3d p_PB = Eigen::Vector3d::Zero();  ///< its origin, expressed in the parent's [m]
  Eigen::Vector3d axis_B = Eigen::Vector3d::UnitZ();  ///< unit, in the body frame
  double mass = 0;                                    ///< [kg]
  Eigen::Vector3d p_Bcm = Eigen::Vector3d::Zero();    ///< centre of mass in the body frame [m]
  Eigen::Matrix3d I_Bcm =
      Eigen::Matrix3d::Zero();  ///< about the centre of mass, body frame [kg m2]
  /// q_tree = multiplier q[coordinate] + offset; a `mimic` joint shares another's coordinate.
  int coordinate = 0;
  double multiplier = 1;
  double offset = 0;  ///< [rad; m]
};

/// Where a URDF link ended up after merging fixed joints.
struct Frame {
  int body = -1;  ///< -1 is the ground
  Eigen::Matrix3d R_BF = Eigen::Matrix3d::Identity();
  Eigen::Vector3d p_BF = Eigen::Vector3d::Zero();
  bool leaf = false;  ///< no joint, not even a fixed one, goes on from this link
};

/// A robot: a tree of revolute and prismatic joints, some of which may mimic others.
struct Model {
  static constexpr double unlimited = std::numeric_limits<double>::infinity();

  int num_joints = 0;  ///< independent coordinates
  std::vector<Body> bodies;
  std::map<std::string, Frame> frames;      ///< by URDF link name
  std::vector<std::string> joint_names;     ///< by coordinate
  std::vector<JointType> joint_types;       ///< by coordinate
  Vector lower, upper;                      ///< [rad; m], +-unlimited where the URDF has none
  Vector effort_limit;                      ///< [N m; N], unlimited where none (or 0) is given
  Vector velocity_limit;                    ///< [rad/s; m/s]
  Eigen::Vector3d gravity = {0, 0, -9.81};  ///< in the root link's frame [m/s2]
  Vector rotor_inertia;  ///< added to the diagonal of M [kg m2]; zero from a URDF; empty is zero
};

/// Reads a URDF text: revolute, continuous, prismatic and fixed joints, `mimic`.
/// `source` is the file name for messages.
///
/// Coordinates are numbered depth-first from the root, the children of a link in the order in
/// which their joints stand in the file; bodies likewise. A mimic joint adds a body, not a
/// coordinate, and its own limits are not read. Links behind fixed joints are merged into the
/// body they are fixed to (or into the ground, where their inertia, like the root link's, is of
/// no consequence). An effort or velocity limit of 0 means none. Visuals, collisions, joint
/// damping, friction, safety controllers and transmissions are ignored: friction is the
/// scenario's.
/// @throw std::invalid_argument, one line naming source, link or joint, value and remedy: XML or
/// URDF that does not parse, duplicated or unknown names, a tree that is none, floating or
/// planar joints, a mimic cycle, an axis of zero length, limits that enclose nothing, more than
/// `max_joints` coordinates or `max_bodies` bodies, inertia no body can have, and massless links
/// that leave a joint without inertia (M not positive definite at any of a few postures).
Model model_from_urdf(const std::string& text, const std::string& source);

/// The model with a point mass [kg] at the origin of `link`. Default: the leaf link farthest from
/// the root, by moving joints, then by distance along the joints' origins at q = 0.
/// @throw std::invalid_argument when the mass is negative or not finite, there is no such link,
/// it does not move, or the default is ambiguous.
Model with_payload(Model model, double mass, const std::string& link = {});

}  // namespace tachless::robot
