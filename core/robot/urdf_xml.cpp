#include "robot/urdf_xml.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

#include "base/elementary.h"
#include "base/text.h"
#include "robot/urdf_elements.h"
#include "robot/xml.h"

namespace tachless::robot {
namespace {

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view blanks = " \t\r\n";
  const std::size_t first = text.find_first_not_of(blanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(blanks) + 1 - first);
}

class Reader {
 public:
  Reader(const std::string& text, const std::string& source) : source_(source) {
    refuse_document_type(text);
    if (const std::string problem = parse_xml(text, document_); !problem.empty()) {
      refuse("{}", problem);
    }
    robot_ = document_.FirstChildElement("robot");
    if (robot_ == nullptr) {
      refuse("no <robot> element: it is {}; give a URDF file", xml_kind(text, source));
    }
    for (const auto* e = robot_->FirstChildElement(); e; e = e->NextSiblingElement()) {
      require_expanded(*e);
      if (is_link(*e) || is_joint(*e)) require_no_xacro(*e);
    }
  }

  [[nodiscard]] std::string mechanics() const {
    XmlDocument kept;
    const char* name = robot_->Attribute("name");
    XmlElement& robot =
        add(kept, "robot", "name", name == nullptr ? "robot" : name);  // used nowhere
    for (const auto* e = robot_->FirstChildElement(); e; e = e->NextSiblingElement()) {
      if (is_link(*e) || is_joint(*e)) add_mechanics(robot, *e);
    }
    return xml_text(kept, false);
  }

  UrdfTree tree(const std::map<std::string, double>& locked) {
    check_no_mechanics(*robot_, "robot");
    for (const auto* e = robot_->FirstChildElement(); e; e = e->NextSiblingElement()) {
      if (is_link(*e)) {
        const std::string name = named(*e, tree_.links);
        check_known(*e, name);
        tree_.links.emplace(name, link(*e));
      } else if (is_joint(*e)) {
        const std::string name = named(*e, tree_.joints);
        check_known(*e, name);
        const UrdfJoint& made = tree_.joints.emplace(name, joint(*e, name, locked)).first->second;
        const auto [above, fresh] = above_.emplace(made.child, name);
        if (!fresh) {
          refuse(
              "link '{}' is the child of two joints, '{}' and '{}': closed chains are not "
              "supported; cut one",
              made.child, above->second, name);
        }
        below_[made.parent].push_back(name);
      } else {
        check_beside_links(*e);
      }
    }
    find_root();
    set_order();
    tree_.mechanics = mechanics();
    if (!inert_.empty()) {
      tree_.warnings.push_back(fmt::format("{}: {} of xacro have no effect and are not read",
                                           source_, fmt::join(inert_, ", ")));
    }
    for (const auto& [what, names] : unknown_) {
      tree_.warnings.push_back(fmt::format("{}: {}: {}", source_, fmt::join(names, ", "), what));
    }
    for (const auto& [what, joints] : assumed_) {
      tree_.warnings.push_back(fmt::format("{}: {} {}: no {} is given; none is assumed", source_,
                                           joints.size() == 1 ? "joint" : "joints",
                                           fmt::join(joints, ", "), what));
    }
    return std::move(tree_);
  }

 private:
  template <class... Args>
  [[noreturn]] void refuse(fmt::format_string<Args...> text, Args&&... args) const {
    refuse_urdf(source_, fmt::format(text, std::forward<Args>(args)...));
  }

  static bool is_link(const XmlElement& e) { return name_of(e) == "link"; }
  static bool is_joint(const XmlElement& e) { return name_of(e) == "joint"; }

  [[noreturn]] void refuse_xacro(const XmlElement& at, std::string_view what) const {
    refuse("line {}: \"{}\" is for xacro; run xacro {} > robot.urdf and give robot.urdf",
           at.GetLineNum(), what, source_);
  }
  /// Refuses an element that xacro would replace; definitions, when nothing uses them any more, are
  /// inert.
  void require_expanded(const XmlElement& e) {
    const std::string& name = name_of(e);
    if (!name.starts_with("xacro:")) return;
    const bool inert = name == "xacro:property" || name == "xacro:macro" || name == "xacro:arg";
    if (!inert) refuse_xacro(e, "<" + name + ">");
    inert_.insert("<" + name + ">");
  }
  /// The same of what is read of a link or joint, and of its attributes.
  void require_no_xacro(const XmlElement& element) {
    for (const auto* a = element.FirstAttribute(); a != nullptr; a = a->Next()) {
      for (const char* mark : {"${", "$("}) {
        if (std::string_view(a->Value()).find(mark) != std::string_view::npos)
          refuse_xacro(element, a->Value());
      }
    }
    for (const auto* e = element.FirstChildElement(); e; e = e->NextSiblingElement()) {
      require_expanded(*e);
    }
    for (const std::string_view name : rule_of(name_of(element))->children) {
      if (const auto* e = element.FirstChildElement(name.data())) require_no_xacro(*e);
    }
  }

  /// Refuses definitions of entities, which the parser does not read.
  void refuse_document_type(std::string_view text) const {
    const std::size_t at = text.find("<!DOCTYPE");
    if (at == std::string_view::npos) return;
    const std::size_t end = text.find_first_of("[>", at);
    if (end == std::string_view::npos || text[end] == '>') return;
    refuse(
        "line {}: <!DOCTYPE … [: an internal DTD is not read; remove it and write what its "
        "entities stand for",
        std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n') + 1);
  }

  /// Says which name was probably meant, or all that are known.
  static std::string known_text(const std::string& name,
                                const std::vector<std::string_view>& known) {
    if (known.empty()) return "it has none that are read";
    if (const auto near = base::nearest(name, known)) return "the nearest known name is " + *near;
    return "known are " + base::joined(known);
  }

  /// Warns of attributes, children and text of a link or joint that are not read. Refuses an
  /// element that is there twice.
  void check_known(const XmlElement& e, const std::string& owner) {
    const ElementRule& rule = *rule_of(name_of(e));
    const auto has = [](const std::vector<std::string_view>& names, std::string_view name) {
      return std::ranges::find(names, name) != names.end();
    };
    for (const auto* a = e.FirstAttribute(); a != nullptr; a = a->Next()) {
      const std::string name = a->Name();
      if (has(rule.attributes, name) || name.starts_with("xmlns")) continue;
      if (name.starts_with("quat")) {
        refuse("line {}: {}: its <{}> has {}; allowed: quat_xyzw=\"x y z w\" or rpy",
               e.GetLineNum(), where_, name_of(e), name);
      }
      warn_unknown(owner, fmt::format("the attribute {} of <{}> is not read; {}", name, name_of(e),
                                      known_text(name, rule.attributes)));
    }
    std::vector<std::string_view> children = rule.children;
    children.insert(children.end(), rule.others.begin(), rule.others.end());
    std::set<std::string> seen;
    for (const auto* node = e.FirstChild(); node != nullptr; node = node->NextSibling()) {
      if (node->ToText() != nullptr && !trimmed(node->Value()).empty()) {
        warn_unknown(
            owner, fmt::format("the text in <{}> is not read; known are {}", name_of(e),
                               base::joined(rule.attributes.empty() ? children : rule.attributes)));
      }
      const XmlElement* const child = node->ToElement();
      if (child == nullptr || name_of(*child).starts_with("xacro:")) continue;
      const std::string& name = name_of(*child);
      if (has(rule.children, name)) {
        if (!seen.insert(name).second) {
          refuse("line {}: {}: its <{}> has two <{}>; remove one", child->GetLineNum(), where_,
                 name_of(e), name);
        }
        check_known(*child, owner);
      } else if (has(rule.others, name)) {
        check_passed_over(*child, owner);
      } else {
        warn_unknown(owner, fmt::format("<{}> in <{}> is not read; {}", name, name_of(e),
                                        known_text(name, children)));
      }
    }
  }
  void warn_unknown(const std::string& owner, const std::string& what) {
    std::vector<std::string>& names = unknown_[what];
    if (names.empty() || names.back() != owner) names.push_back(owner);
  }

  /// Warns of attributes with mechanics in an element that has none.
  void check_no_mechanics(const XmlElement& e, const std::string& owner) {
    for (const auto* a = e.FirstAttribute(); a != nullptr; a = a->Next()) {
      if (!is_mechanics(a->Name())) continue;
      warn_unknown(owner,
                   fmt::format("the attribute {} of <{}> is not read", a->Name(), name_of(e)));
    }
  }

  /// Warns of mechanics in an element that is not read, such as <visual>.
  void check_passed_over(const XmlElement& e, const std::string& owner) {
    if (name_of(e) != "origin") check_no_mechanics(e, owner);
    for (const auto* child = e.FirstChildElement(); child; child = child->NextSiblingElement()) {
      if (rule_of(name_of(*child)) != nullptr && name_of(*child) != "origin") {
        warn_unknown(owner, fmt::format("<{}> in <{}> is not read", name_of(*child), name_of(e)));
      }
      check_passed_over(*child, owner);
    }
  }

  /// Returns whether a link with mass or a joint between links is somewhere below an element.
  static bool holds_mechanics(const XmlElement& e) {
    for (const auto* child = e.FirstChildElement(); child; child = child->NextSiblingElement()) {
      const bool found = is_link(*child) ? child->FirstChildElement("inertial") != nullptr
                                         : is_joint(*child) && child->FirstChildElement("parent");
      if (found || holds_mechanics(*child)) return true;
    }
    return false;
  }

  /// Warns of what stands beside the links and joints and was probably meant to be read.
  void check_beside_links(const XmlElement& e) {
    const std::string& name = name_of(e);
    if (name == "include" || name == "xi:include") {
      refuse("line {}: <{}> is not followed; give a URDF that is whole", e.GetLineNum(), name);
    }
    if (name == "transmission") return warn_of_rotor(e);
    // A model of its own may be in them.
    if (name == "gazebo" || name.starts_with("xacro:")) return;
    const char* const given = e.Attribute("name");
    const std::string owner = given == nullptr ? "robot" : given;
    if (holds_mechanics(e)) {
      return warn_unknown(owner, fmt::format("the links and joints in <{}> are not read", name));
    }
    const auto& known = robot_children();
    if (std::ranges::find(known, name) != known.end()) return;
    if (rule_of(name) != nullptr) {
      return warn_unknown(owner, fmt::format("<{}> in <robot> is not read; it belongs in a link or "
                                             "joint",
                                             name));
    }
    const std::vector<std::string_view> meant{"link", "joint"};
    if (const auto near = base::nearest(name, meant)) {
      warn_unknown(owner, fmt::format("<{}> in <robot> is not read; the nearest known name is {}",
                                      name, *near));
    }
  }

  /// Warns of a rotor inertia in Drake's dialect.
  void warn_of_rotor(const XmlElement& transmission) {
    const auto* const joint = transmission.FirstChildElement("joint");
    const auto* const actuator = transmission.FirstChildElement("actuator");
    if (joint == nullptr || actuator == nullptr) return;
    const auto* const rotor = actuator->FirstChildElement("drake:rotor_inertia");
    const auto* const gear = actuator->FirstChildElement("drake:gear_ratio");
    if (rotor == nullptr) return;
    where_ = "transmission";
    const double inertia = number(rotor, "value", 0), ratio = number(gear, "value", 1);
    const char* const name = joint->Attribute("name");
    warn_unknown(
        name == nullptr ? "transmission" : name,
        fmt::format("<drake:rotor_inertia> is not read; it is {:g} * {:g}^2 = {:g} kg m2 "
                    "at the joint; give robot.joints: {{rigid: {{rotor_inertia_kgm2: …}}}}",
                    inertia, ratio, inertia * ratio * ratio));
  }

  /// Adds an element with its attributes, and its elements that are read, the first of each kind.
  static void add_mechanics(XmlElement& to, const XmlElement& from) {
    XmlElement& kept = add(to, from.Name());
    for (const auto* a = from.FirstAttribute(); a != nullptr; a = a->Next()) {
      set(kept, a->Name(), a->Value());
    }
    for (const std::string_view name : rule_of(name_of(from))->children) {
      if (const auto* e = from.FirstChildElement(name.data())) add_mechanics(kept, *e);
    }
  }

  /// The name of a link or joint, under which nothing is in `known` yet; messages begin with it.
  template <class Value>
  std::string named(const XmlElement& e, const std::map<std::string, Value>& known) {
    const char* name = e.Attribute("name");
    if (name == nullptr || *name == '\0') {
      refuse("line {}: a {} has no name; give it name=\"...\"", e.GetLineNum(), name_of(e));
    }
    where_ = fmt::format("{} '{}'", name_of(e), name);
    if (!is_urdf_name(name)) {
      refuse(
          "line {}: {}: not a name; allowed: up to 200 printable characters, a letter, digit, _ . "
          "or "
          "/ first, no quotes and none of `\\<>&$;|{{}}[],*?!~^%=",
          e.GetLineNum(), where_);
    }
    if (known.contains(name)) {
      refuse("line {}: {} is defined twice; rename one", e.GetLineNum(), where_);
    }
    return name;
  }

  const XmlElement& child(const XmlElement& in, const char* name) const {
    if (const XmlElement* found = in.FirstChildElement(name)) return *found;
    refuse("line {}: {}: its <{}> has no <{}>; add one", in.GetLineNum(), where_, name_of(in),
           name);
  }
  const char* attribute(const XmlElement& element, const char* name) const {
    if (const char* given = element.Attribute(name)) return given;
    refuse("line {}: {}: its <{}> has no {}; add one", element.GetLineNum(), where_,
           name_of(element), name);
  }
  static bool gives(const XmlElement* element, const char* name) {
    return element != nullptr && element->Attribute(name) != nullptr;
  }
  [[noreturn]] void refuse_value(const XmlElement& element, const char* name,
                                 const char* allowed) const {
    refuse("line {}: {}: its <{}> has {}=\"{}\"; allowed: {}", element.GetLineNum(), where_,
           name_of(element), name, element.Attribute(name), allowed);
  }

  double number(const XmlElement& element, const char* name) const {
    const std::optional<double> value = finite_number(trimmed(attribute(element, name)));
    if (!value) refuse_value(element, name, "a finite number");
    return *value;
  }
  double number(const XmlElement* element, const char* name, double otherwise) const {
    return gives(element, name) ? number(*element, name) : otherwise;
  }
  /// The numbers of an attribute that is there; none where one of them is no finite number.
  static std::vector<double> numbers(const XmlElement& element, const char* name) {
    return finite_numbers(element.Attribute(name)).value_or(std::vector<double>());
  }
  Eigen::Vector3d vector(const XmlElement* element, const char* name,
                         const Eigen::Vector3d& otherwise = Eigen::Vector3d::Zero()) const {
    if (!gives(element, name)) return otherwise;
    const std::vector<double> v = numbers(*element, name);
    if (v.size() == 3) return {v[0], v[1], v[2]};
    refuse_value(*element, name, "three finite numbers");
  }

  /// Reads rpy or quat_xyzw of an <origin>. @param largest of the angles as written [rad]
  void set_rotation(const XmlElement* origin, Eigen::Matrix3d& R, double& largest) const {
    const Eigen::Vector3d rpy = vector(origin, "rpy");
    largest = rpy.cwiseAbs().maxCoeff();
    R = rotation_of(rpy);
    if (!gives(origin, "quat_xyzw")) return;
    if (gives(origin, "rpy")) {
      refuse("line {}: {}: its <origin> has both rpy and quat_xyzw; remove one",
             origin->GetLineNum(), where_);
    }
    const std::vector<double> q = numbers(*origin, "quat_xyzw");
    constexpr double tolerance = 1e-3;
    const auto unit = [&] { return Eigen::Map<const Eigen::Vector4d>(q.data()).norm(); };
    if (q.size() != 4 || std::abs(unit() - 1) > tolerance) {
      refuse_value(*origin, "quat_xyzw", "four finite numbers x y z w of length 1");
    }
    R = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).normalized().toRotationMatrix();
  }

  UrdfLink link(const XmlElement& e) const {
    UrdfLink made;
    const XmlElement* inertial = e.FirstChildElement("inertial");
    if (inertial == nullptr) return made;
    const XmlElement* origin = inertial->FirstChildElement("origin");
    set_rotation(origin, made.R, made.largest_angle);
    made.mass.p_Bcm = vector(origin, "xyz");
    made.mass.mass = number(child(*inertial, "mass"), "value");
    const XmlElement& I = child(*inertial, "inertia");
    // Read before the list of Eigen begins: it aborts when an exception leaves it unfinished.
    const double xx = number(I, "ixx"), yy = number(I, "iyy"), zz = number(I, "izz");
    const double xy = number(I, "ixy"), xz = number(I, "ixz"), yz = number(I, "iyz");
    made.mass.I_Bcm << xx, xy, xz, xy, yy, yz, xz, yz, zz;
    return made;
  }

  UrdfJoint joint(const XmlElement& e, const std::string& name,
                  const std::map<std::string, double>& locked) {
    UrdfJoint made;
    made.name = name;
    made.parent = attribute(child(e, "parent"), "link");
    made.child = attribute(child(e, "child"), "link");
    const XmlElement* origin = e.FirstChildElement("origin");
    set_rotation(origin, made.R, made.largest_angle);
    made.p = vector(origin, "xyz");
    set_type(e, locked, made);
    if (!made.fixed) made.axis = vector(e.FirstChildElement("axis"), "xyz", made.axis);
    if (const XmlElement* mimic = e.FirstChildElement("mimic")) {
      made.mimic = MimicRelation{attribute(*mimic, "joint"), number(mimic, "multiplier", 1),
                                 number(mimic, "offset", 0)};
    }
    if (const XmlElement* dynamics = e.FirstChildElement("dynamics")) {
      if (!gives(dynamics, "friction") && !gives(dynamics, "armature")) {
        (void)attribute(*dynamics, "damping");
      }
      made.damping = number(dynamics, "damping", 0);
      made.friction = number(dynamics, "friction", 0);
      made.armature = number(dynamics, "armature", 0);
    }
    if (const auto* end = e.FirstChildElement("position_based_velocity_limits")) {
      made.deceleration_limit = number(*end, "deceleration_limit");
      made.velocity_offset = number(*end, "velocity_offset");
      if (!(made.deceleration_limit > 0)) refuse_value(*end, "deceleration_limit", "above 0");
      if (!(made.velocity_offset >= 0)) refuse_value(*end, "velocity_offset", "0 or more");
    }
    const bool warns = !made.fixed && !made.mimic && locked.count(name) == 0;
    set_limits(e.FirstChildElement("limit"), warns, made);
    return made;
  }

  void set_type(const XmlElement& e, const std::map<std::string, double>& locked,
                UrdfJoint& made) const {
    const char* given = e.Attribute("type");
    const std::string type = given == nullptr ? "" : given;
    if (type == "prismatic") made.type = JointType::prismatic;
    made.has_range = type == "prismatic" || type == "revolute";
    made.fixed = !made.has_range && type != "continuous";
    if (!made.fixed || type == "fixed") return;
    const std::string problem = type.empty()
                                    ? where_ + ": has no type"
                                    : fmt::format("{}: type {} is not supported", where_, type);
    const auto lock = locked.find(made.name);
    if (lock == locked.end()) {
      refuse(
          "{}; use revolute, continuous, prismatic or fixed, or fix it in the scenario: "
          "robot.locked: {{{}: 0}}",
          problem, made.name);
    }
    if (lock->second != 0)
      refuse("{}; it can be locked at 0 only, not at {}", problem, lock->second);
  }

  /// @param warns of limits that are not given
  void set_limits(const XmlElement* limit, bool warns, UrdfJoint& made) {
    for (const auto& [name, value] : {std::pair{"lower", &made.lower},
                                      {"upper", &made.upper},
                                      {"effort", &made.effort},
                                      {"velocity", &made.velocity}}) {
      *value = number(limit, name, 0);
    }
    made.zero_effort = gives(limit, "effort") && made.effort == 0;
    made.zero_velocity = gives(limit, "velocity") && made.velocity == 0;
    if (limit == nullptr && !made.has_range) return;
    for (const char* what : {"effort", "velocity"}) {
      if (warns && !gives(limit, what))
        assumed_[fmt::format("{} limit", what)].push_back(made.name);
    }
    const bool lower = gives(limit, "lower"), upper = gives(limit, "upper");
    if (!made.has_range) {
      if (warns && (lower || upper)) {
        warn_unknown(made.name, "the range of a continuous joint is not used");
      }
      return;
    }
    // Exporters without limits write four zeros.
    const bool zeros = made.lower == 0 && made.upper == 0 && made.effort == 0 && made.velocity == 0;
    made.has_range = lower && upper ? !zeros : lower || upper;
    if (warns && !made.has_range) assumed_["range (lower, upper)"].push_back(made.name);
    if (warns && lower != upper) {
      warn_unknown(made.name,
                   fmt::format("{} is not given; 0 is taken", lower ? "upper" : "lower"));
    }
  }

  void find_root() {
    for (const auto& [name, joint] : tree_.joints) {
      for (const auto& [end, link] :
           {std::pair{"parent", &joint.parent}, {"child", &joint.child}}) {
        if (tree_.links.contains(*link)) continue;
        if (link == &joint.parent && *link == "world") {
          tree_.links.emplace("world", UrdfLink{});
          tree_.warnings.push_back(fmt::format(
              "{}: joint '{}': its parent link 'world' is not in the file; it is taken for the "
              "ground",
              source_, name));
          continue;
        }
        refuse("joint '{}': its {} link '{}' is not in the file; correct the name, or add the link",
               name, end, *link);
      }
    }
    for (const auto& [name, unused] : tree_.links) {
      if (above_.contains(name)) continue;
      if (!tree_.root.empty()) {
        refuse("links '{}' and '{}' hang on no joint: two root links; join them by a fixed joint",
               tree_.root, name);
      }
      tree_.root = name;
    }
    if (tree_.links.empty()) refuse("it has no link; give a URDF file");
  }

  /// Refuses joints that close a chain.
  void set_order() {
    // A stack of its own, since nothing bounds a chain of fixed links.
    std::vector<std::string> open;
    const auto open_below = [&](const std::string& link) {
      const auto joints = below_.extract(link);
      if (joints) open.insert(open.end(), joints.mapped().rbegin(), joints.mapped().rend());
    };
    open_below(tree_.root);
    while (!open.empty()) {
      tree_.order.push_back(std::move(open.back()));
      open.pop_back();
      open_below(tree_.joints.at(tree_.order.back()).child);
    }
    if (below_.empty()) return;
    std::string at = below_.begin()->first;
    for (std::set<std::string> walked; walked.insert(at).second;) {
      at = tree_.joints.at(above_.at(at)).parent;
    }
    refuse("joint '{}' hangs link '{}' on its own descendant; hang it on a link nearer the root",
           above_.at(at), at);
  }

  const std::string& source_;
  XmlDocument document_;
  const XmlElement* robot_ = nullptr;
  std::set<std::string> inert_;  ///< elements of xacro that have no effect
  std::string where_;            ///< the link or joint that is being read
  UrdfTree tree_;
  std::map<std::string, std::string> above_;  ///< joint by child link
  std::map<std::string, std::vector<std::string>>
      below_;  ///< joints by parent link, as in the file
  /// Links and joints by what of them is not read.
  std::map<std::string, std::vector<std::string>> unknown_;
  /// Joints by what is not given, and then assumed: a file repeats itself from joint to joint.
  std::map<std::string, std::vector<std::string>> assumed_;
};

}  // namespace

void refuse_urdf(const std::string& source, const std::string& problem) {
  std::string line = source + ": " + problem;
  std::replace_if(
      line.begin(), line.end(), [](char c) { return c == '\n' || c == '\r' || c == '\t'; }, ' ');
  throw std::invalid_argument(line);
}

Eigen::Matrix3d rotation_of(const Eigen::Vector3d& rpy) {
  double s[3], c[3];  // of half the angles
  for (int i = 0; i < 3; ++i) base::sin_cos(rpy[i] / 2, s[i], c[i]);
  return Eigen::Quaterniond(
             c[0] * c[1] * c[2] + s[0] * s[1] * s[2], s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
             c[0] * s[1] * c[2] + s[0] * c[1] * s[2], c[0] * c[1] * s[2] - s[0] * s[1] * c[2])
      .normalized()
      .toRotationMatrix();
}

std::string urdf_mechanics(const std::string& text, const std::string& source) {
  return Reader(text, source).mechanics();
}

UrdfTree read_urdf_xml(const std::string& text, const std::string& source,
                       const std::map<std::string, double>& locked) {
  return Reader(text, source).tree(locked);
}

}  // namespace tachless::robot
