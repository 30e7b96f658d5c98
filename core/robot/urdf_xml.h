#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "robot/model.h"

/// A URDF's XML as plain values. The reader checks syntax, names, tree, types and numbers.
/// Coordinates, merged links and possible inertias are in urdf.cpp.
namespace tachless::robot {

/// Throws std::invalid_argument "<source>: <problem>", on one line.
[[noreturn]] void refuse_urdf(const std::string& source, const std::string& problem);

/// Returns the rotation of roll, pitch and yaw. Zeros give exactly the identity.
Eigen::Matrix3d rotation_of(const Eigen::Vector3d& rpy);

/// The <inertial> of a link; zero without one.
struct UrdfLink {
  MassProperties mass;  ///< mass properties; I_Bcm is in the inertial's axes
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();  ///< rotation from the inertial's axes
  double largest_angle = 0;  ///< largest angle of the inertial's rpy as written [rad]
};

/// The position of a joint as an affine map of another joint's position q: multiplier q + offset.
struct MimicRelation {
  std::string joint;
  double multiplier = 1, offset = 0;
};

struct UrdfJoint {
  std::string name, parent, child;
  bool fixed = false;  ///< true also for a locked joint of an unsupported type
  JointType type = JointType::revolute;
  Eigen::Matrix3d R;  ///< rotation of the child's frame in the parent's
  Eigen::Vector3d p;
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX();
  bool has_range = false;
  double lower = 0, upper = 0, effort = 0, velocity = 0;  ///< 0: not given
  bool zero_effort = false, zero_velocity = false;        ///< the limit is given as 0
  /// Attributes of <position_based_velocity_limits>; 0: not given.
  double deceleration_limit = 0, velocity_offset = 0;
  double damping = 0, friction = 0, armature = 0;
  double largest_angle = 0;  ///< largest angle of the origin's rpy as written [rad]
  std::optional<MimicRelation> mimic;
};

struct UrdfTree {
  std::map<std::string, UrdfLink> links;
  std::map<std::string, UrdfJoint> joints;
  std::string root;                ///< the link that no joint carries
  std::vector<std::string> order;  ///< joints, depth-first, siblings as in the file
  std::vector<std::string> warnings;
  std::string mechanics;  ///< text as `urdf_mechanics` returns it
};

/// Reads a URDF's XML.
/// @param locked joints that are to be fixed; their type may be any, at position 0
/// @throw std::invalid_argument on malformed XML or remains of xacro, on duplicated, missing or
/// unknown names, on unsupported types, on values that are no finite number, and on links that are
/// not one tree
UrdfTree read_urdf_xml(const std::string& text, const std::string& source,
                       const std::map<std::string, double>& locked);

/// Returns a line for each number that is allowed in a URDF but improbable: limits of 0, degrees,
/// millimetres, grams, a radius of gyration beyond the link, mass without inertia.
/// @throw std::invalid_argument as `read_urdf_xml`
std::vector<std::string> improbable_numbers(const std::string& text, const std::string& source,
                                            const std::map<std::string, double>& locked);

/// Returns the model of `tree`, which was read with the same source and `options.locked`.
/// @throw std::invalid_argument as `read_urdf`
Model model_of(UrdfTree tree, const std::string& source, const UrdfOptions& options);

/// Returns a URDF's mechanics (`urdf_mechanics`) with other <inertial>s for these links, in their
/// own frames. A link without mass and inertia in `links` gets no <inertial>.
std::string urdf_with_inertials(const std::string& text,
                                const std::map<std::string, MassProperties>& links);

/// Returns true if a link or joint may have this name (not empty). Names get into files, pages and
/// lines of other programs. A name is printable, short, and has no character with a meaning there.
bool is_urdf_name(std::string_view text);

/// Returns the kind of an XML text and a remedy: "a URDF; …". Messages use it when a file is of
/// another kind than expected.
/// @param source name of the text's file
std::string xml_kind(std::string_view text, const std::string& source);

}  // namespace tachless::robot
