#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "robot/model.h"

class TiXmlNode;

/// A URDF's XML as plain values: syntax, names, tree, types and numbers are checked. Knows nothing
/// of coordinates, of merged links and of what an inertia can be (urdf.cpp).
namespace tachless::robot {

/// Throws std::invalid_argument "<source>: <problem>", on one line.
[[noreturn]] void refuse_urdf(const std::string& source, const std::string& problem);

/// Of roll, pitch and yaw; exactly 1 for zeros.
Eigen::Matrix3d rotation_of(const Eigen::Vector3d& rpy);

/// The <inertial> of a link; zero where it has none.
struct UrdfLink {
  MassProperties mass;                              ///< I_Bcm in axes that R turns
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();  ///< of the inertial's axes in the link's
  double largest_angle = 0;                         ///< of the inertial's rpy as written [rad]
};

/// The position of a joint as an affine map of another's: multiplier q + offset.
struct MimicRelation {
  std::string joint;
  double multiplier = 1, offset = 0;
};

struct UrdfJoint {
  std::string name, parent, child;
  bool fixed = false;  ///< also a locked one of a type that is not supported
  JointType type = JointType::revolute;
  Eigen::Matrix3d R;  ///< of the child's frame in the parent's
  Eigen::Vector3d p;
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX();
  bool has_range = false;
  double lower = 0, upper = 0, effort = 0, velocity = 0;  ///< 0: not given
  bool zero_effort = false, zero_velocity = false;        ///< the limit is given as 0
  double damping = 0, friction = 0;
  double largest_angle = 0;  ///< of the origin's rpy as written [rad]
  std::optional<MimicRelation> mimic;
};

struct UrdfTree {
  std::map<std::string, UrdfLink> links;
  std::map<std::string, UrdfJoint> joints;
  std::string root;                ///< the link that hangs on no joint
  std::vector<std::string> order;  ///< of the joints, depth-first, siblings as in the file
  std::vector<std::string> warnings;
  std::string mechanics;  ///< as `urdf_mechanics`
};

/// @param locked joints that are to be fixed; their type may be any, at position 0
/// @throw std::invalid_argument on malformed XML, what xacro has left, duplicated, missing or
/// unknown names, unsupported types, what is not a finite number, and what is not one tree
UrdfTree read_urdf_xml(const std::string& text, const std::string& source,
                       const std::map<std::string, double>& locked);

/// Returns a line for each number that a URDF may have and that is improbable: effort or velocity
/// limits of 0, degrees, millimetres, grams, a radius of gyration beyond the link, mass without
/// inertia.
/// @throw std::invalid_argument as `read_urdf_xml`
std::vector<std::string> improbable_numbers(const std::string& text, const std::string& source,
                                            const std::map<std::string, double>& locked);

/// The second half of `read_urdf`: `tree` was read with the same source and `options.locked`.
/// @throw std::invalid_argument as `read_urdf`
Model model_of(UrdfTree tree, const std::string& source, const UrdfOptions& options);

/// A URDF's mechanics (`urdf_mechanics`) with other <inertial>s for these links, in their own
/// frames; without one for a link that has no mass and no inertia here.
std::string urdf_with_inertials(const std::string& text,
                                const std::map<std::string, MassProperties>& links);

/// Why a text is not given to the XML parser, which recurses and takes quadratic time; empty when
/// it is.
std::string why_too_large(std::string_view text);

/// Returns the line of the first markup below `node` that is no element, text or comment, such as
/// `<&axis …>` or `<?axis …>`: the parser passes it over. Returns 0 if there is none. A document
/// may have a document type and instructions beside its root.
int line_of_unread_markup(const TiXmlNode& node);

/// Whether a link or joint may be called this (not empty). Names end in files, pages and lines of
/// other programs: printable, short, and none of the characters that one of those would obey.
bool is_urdf_name(std::string_view text);

/// What an XML text is, for a message where something else is wanted, and what to do: "a URDF; …".
/// @param source its file's name
std::string xml_kind(std::string_view text, const std::string& source);

}  // namespace tachless::robot
