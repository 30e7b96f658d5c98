#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <list>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "robot/mjcf.h"
#include "robot/xml.h"

namespace tachless::robot {

class MjcfDocument;

/// Attributes of one element: its own, and the attributes of its class that it does not give.
class MjcfAttributes {
 public:
  using Values = std::map<std::string, std::string>;
  MjcfAttributes(const MjcfDocument& document, const XmlElement& element, Values values)
      : document_(&document), element_(&element), values_(std::move(values)) {}

  [[nodiscard]] const XmlElement& element() const { return *element_; }
  [[nodiscard]] bool has(const std::string& name) const { return values_.contains(name); }
  [[nodiscard]] std::string text(const std::string& name, const std::string& otherwise = "") const;
  [[nodiscard]] double number(const std::string& name, double otherwise) const;
  /// Returns the first of several coefficients from 0 on. The coefficients of higher
  /// powers have to be 0.
  [[nodiscard]] double coefficient(const std::string& name) const;
  /// Returns `least` to `most` numbers, or none if the attribute is not given.
  [[nodiscard]] std::vector<double> numbers(const std::string& name, std::size_t least,
                                            std::size_t most) const;
  [[nodiscard]] Eigen::Vector3d vector(const std::string& name,
                                       const Eigen::Vector3d& otherwise) const;
  /// Returns true or false; `otherwise` for auto, and if the attribute is not given.
  [[nodiscard]] bool flag(const std::string& name, bool otherwise) const;
  /// Returns the range `name` if it is in force: the flag `limited` is true, or is auto and the
  /// range is given.
  [[nodiscard]] std::optional<std::pair<double, double>> range(const std::string& name,
                                                               const std::string& limited) const;
  /// @throw std::invalid_argument "source: line N: <element> 'name': problem"
  [[noreturn]] void refuse(const std::string& problem) const;

 private:
  const MjcfDocument* document_;
  const XmlElement* element_;
  Values values_;
};

/// A frame's place in another frame.
struct MjcfPose {
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
  Eigen::Vector3d p = Eigen::Vector3d::Zero();

  MjcfPose operator*(const MjcfPose& inner) const { return {q * inner.q, p + q * inner.p}; }
};

/// An MJCF's elements with included files in place, and the defaults of its classes. The class
/// checks the names of elements and attributes. It knows no mechanics.
class MjcfDocument {
 public:
  /// @throw std::invalid_argument for malformed XML, a file that is included twice, and faults of
  /// <compiler> and <default>
  MjcfDocument(const std::string& text, std::string source, const IncludedText& included);
  MjcfDocument(const MjcfDocument&) = delete;
  MjcfDocument& operator=(const MjcfDocument&) = delete;

  /// Returns the children of an element, with an included file's elements in place of <include>.
  [[nodiscard]] std::vector<const XmlElement*> children(const XmlElement& parent) const;
  /// Returns the children of all sections of a name, such as "equality".
  [[nodiscard]] std::vector<const XmlElement*> in_sections(std::string_view section) const;
  [[nodiscard]] std::vector<const XmlElement*> sections(std::string_view section) const;
  /// Returns the attributes of an element after a check of the names in it.
  /// @param around default class for elements that name no class
  /// @param rule key of `mjcf_rule`; empty: the element's name
  [[nodiscard]] MjcfAttributes attributes(const XmlElement& element, const std::string& around,
                                          std::string_view rule = {}) const;
  /// Returns the attributes that an element has itself. Their names are not checked.
  [[nodiscard]] MjcfAttributes own_attributes(const XmlElement& element) const;
  [[nodiscard]] const MjcfAttributes& compiler() const { return *compiler_; }
  [[nodiscard]] const XmlElement& root() const { return *root_; }
  /// Returns `pos` and the orientation that an element gives in one of MuJoCo's forms.
  [[nodiscard]] MjcfPose pose(const MjcfAttributes& frame) const;
  /// Returns the factor from the file's unit of angles to radians.
  [[nodiscard]] double angle_unit() const;
  /// Returns "source: line N", with the included file's name if there is one.
  [[nodiscard]] std::string where(const XmlElement& at) const;
  [[noreturn]] void refuse(const XmlElement& at, const std::string& problem) const;

 private:
  void parse(const std::string& text, const std::string& file);
  void read_includes(const XmlElement& parent, const IncludedText& included);
  void check_names(const XmlElement& element, std::string_view known_as) const;
  void read_top_defaults(const XmlElement& section);
  void read_class(const XmlElement& element, const std::string& name,
                  std::map<std::string, MjcfAttributes::Values> values);

  std::string source_;
  std::list<XmlDocument> files_;
  std::map<const XmlDocument*, std::string> names_;  ///< file names of the included documents
  std::map<const XmlElement*, const XmlElement*> included_;  ///< root of the file, by <include>
  const XmlElement* root_ = nullptr;
  std::optional<MjcfAttributes> compiler_;
  /// Attributes by element, by class.
  std::map<std::string, std::map<std::string, MjcfAttributes::Values>> classes_;
  std::string top_class_ = "main";
};

/// Returns the rotation about an axis by an angle [rad].
Eigen::Quaterniond rotation_about(const Eigen::Vector3d& axis, double angle);

/// Returns the rotation that turns the z axis to a direction by the smallest angle.
Eigen::Quaterniond from_z_to(const Eigen::Vector3d& direction);

}  // namespace tachless::robot
