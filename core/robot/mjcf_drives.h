#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "robot/mjcf_document.h"

namespace tachless::robot {

/// A linear <equality><joint>: q - ref = multiplier (q_other - ref_other) + offset.
struct MjcfMimic {
  std::string joint;  ///< the other joint
  double multiplier = 1, offset = 0;
  const XmlElement* equality = nullptr;
};

/// Returns the attributes of an actuator. Refuses an actuator with armature or damping.
MjcfAttributes actuator_attributes(const MjcfDocument& document, const XmlElement& actuator);

/// The actuators, tendons and equalities of an MJCF: force limits of joints, and mimic joints.
class MjcfDrives {
 public:
  /// @throw std::invalid_argument for tendons and equalities with mechanics that a URDF cannot hold
  explicit MjcfDrives(const MjcfDocument& document);

  /// Returns the largest force of a joint that actuators and `actuatorfrcrange` allow.
  [[nodiscard]] std::optional<double> effort_of(const MjcfAttributes& joint,
                                                const std::string& name) const;
  /// Returns the mimic joints with their relations.
  [[nodiscard]] const std::map<std::string, MjcfMimic>& mimics() const { return mimics_; }
  /// Refuses actuators and equalities of joints that are not among these.
  void require_joints(const std::set<std::string>& joints) const;
  [[nodiscard]] const std::vector<std::string>& warnings() const { return warnings_; }

 private:
  void warn(const XmlElement& at, const std::string& problem);
  void read_tendon(const XmlElement& tendon);
  void read_equality(const XmlElement& equality);
  void read_actuator(const XmlElement& element);
  std::optional<double> force_of(const MjcfAttributes& actuator);
  std::optional<double> smaller_side(const MjcfAttributes& attributes, const std::string& range,
                                     const std::string& limited);

  const MjcfDocument& document_;
  std::map<std::string, double> efforts_;  ///< by joint
  std::map<std::string, MjcfMimic> mimics_;
  /// joints, with the elements that name them
  std::vector<std::pair<std::string, const XmlElement*>> named_;
  std::vector<std::string> warnings_;
};

}  // namespace tachless::robot
