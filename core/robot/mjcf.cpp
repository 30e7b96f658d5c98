#include "robot/mjcf.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <set>
#include <utility>

#include "base/text.h"
#include "robot/mjcf_document.h"
#include "robot/mjcf_drives.h"
#include "robot/mjcf_inertia.h"
#include "robot/urdf_xml.h"

namespace tachless::robot {
namespace {

std::string text_of(const Eigen::Vector3d& v) {
  return fmt::format("{} {} {}", v.x(), v.y(), v.z());
}

void add_origin(XmlElement& to, const MjcfPose& pose) {
  XmlElement& origin = add(to, "origin", "xyz", text_of(pose.p));
  const Eigen::Quaterniond& q = pose.q;
  if (!q.vec().isZero(0)) {
    set(origin, "quat_xyzw", fmt::format("{} {} {} {}", q.x(), q.y(), q.z(), q.w()));
  }
}

class Converter {
 public:
  Converter(const std::string& text, const std::string& source, const IncludedText& included)
      : document_(text, source, included), drives_(document_) {}

  Description description() {
    check_compiler();
    check_options();
    read_assets();
    const std::string name = document_.root().Attribute("model") == nullptr
                                 ? "robot"
                                 : document_.root().Attribute("model");
    set(robot_, "name", base::printable(name));
    add(robot_, "link", "name", world);
    for (const XmlElement* each : document_.sections("worldbody")) {
      (void)document_.attributes(*each, "main");
      for (const XmlElement* child : document_.children(*each)) {
        read_child(*child, {world, {}, "main", {}, false});
      }
    }
    drives_.require_joints(joints_);
    for (const auto& [joint, mimic] : drives_.mimics()) add_mimic(joint, mimic);
    read_keyframe();
    compare_gravcomp();
    made_.urdf = xml_text(urdf_, true);
    for (const std::string& each : drives_.warnings()) made_.warnings.push_back(each);
    return std::move(made_);
  }

 private:
  static constexpr const char* world = "world";

  /// Surroundings of an element in the tree of bodies.
  struct Place {
    std::string link;        ///< the link that carries the body around the element
    MjcfPose frame;          ///< the frame around the element, in the link
    std::string childclass;  ///< class of elements without one
    MjcfPose in_body;        ///< the <frame>s around the element, in the body
    bool moves = false;      ///< a joint is between world and the body
  };

  /// Children of a body that describe the body itself.
  struct BodyContent {
    std::vector<std::pair<MjcfAttributes, MjcfPose>> joints, geoms;  ///< each with its <frame>s
    std::optional<MjcfAttributes> inertial;
  };

  /// A mesh as a URDF draws it.
  struct Mesh {
    std::string filename, scale;  ///< the scale is empty if it is not given
  };

  struct Moving {
    XmlElement* element = nullptr;
    double ref = 0;  ///< position at which the bodies are as written [rad; m]
  };

  void warn(const XmlElement& at, const std::string& problem) {
    made_.warnings.push_back(base::one_line(document_.where(at) + ": " + problem));
  }

  void check_compiler() const {
    const MjcfAttributes& compiler = document_.compiler();
    for (const auto& [name, allowed] :
         {std::pair{"coordinate", "local"}, {"inertiafromgeom", ""}}) {
      const std::string given = compiler.text(name, allowed);
      if (*allowed != '\0' && given != allowed) {
        compiler.refuse(fmt::format("{}=\"{:.60}\"; allowed: {}", name, given, allowed));
      }
    }
    (void)compiler.flag("inertiafromgeom", false);
    if (compiler.number("settotalmass", -1) > 0) {
      compiler.refuse("settotalmass is not read; give the masses themselves");
    }
  }

  /// Warns of options that a scenario has instead. Refuses those that switch mechanics off.
  void check_options() {
    for (const XmlElement* each : document_.sections("option")) {
      const MjcfAttributes option = document_.own_attributes(*each);
      const Eigen::Vector3d usual(0, 0, -9.81);
      if (option.vector("gravity", usual) != usual) {
        warn(*each, fmt::format("gravity=\"{}\" is not read; robot.gravity_m_per_s2 and robot.base "
                                "of the scenario count",
                                option.text("gravity")));
      }
      for (const char* name : {"density", "viscosity"}) {
        if (option.number(name, 0) != 0) warn(*each, fmt::format("{} is not read", name));
      }
      for (const XmlElement* flag : document_.children(*each)) {
        if (name_of(*flag) != "flag") continue;
        const MjcfAttributes flags = document_.own_attributes(*flag);
        for (const char* name : {"equality", "frictionloss", "passive", "spring", "damper"}) {
          if (flags.text(name, "enable") == "enable") continue;
          flags.refuse(fmt::format("{}=\"{:.60}\" is not read; remove it, and what it switches off",
                                   name, flags.text(name)));
        }
      }
    }
  }

  /// Remembers the files of meshes and the colours of materials, by name.
  void read_assets() {
    namespace fs = std::filesystem;
    const MjcfAttributes& compiler = document_.compiler();
    const fs::path folder = compiler.text("meshdir", compiler.text("assetdir"));
    for (const XmlElement* each : document_.in_sections("asset")) {
      const bool mesh = name_of(*each) == "mesh";
      if (!mesh && name_of(*each) != "material") continue;
      const MjcfAttributes asset = document_.attributes(*each, "main");
      if (!mesh) {
        colours_[asset.text("name")] = asset.text("rgba");
        continue;
      }
      fs::path file = asset.text("file");
      const std::string stem = file.stem().string();
      if (compiler.flag("strippath", false)) file = file.filename();
      Mesh drawn{(folder / file).string(), ""};
      if (asset.has("scale")) {
        drawn.scale = text_of(asset.vector("scale", Eigen::Vector3d::Ones()));
      }
      if (!file.empty()) meshes_.emplace(asset.text("name", stem), std::move(drawn));
    }
  }

  /// Reads a child of <worldbody>, of a body, or of a <frame>, that is a body, a frame or, in the
  /// world, a geom.
  void read_child(const XmlElement& child, const Place& place) {
    const std::string& kind = name_of(child);
    if (kind == "body") {
      read_body(child, place);
    } else if (kind == "frame") {
      const Place inner = inside(child, place);
      for (const XmlElement* each : document_.children(child)) read_child(*each, inner);
    } else if (kind == "geom" && place.link == world && !place.moves) {
      XmlElement& link = *robot_.FirstChildElement("link");
      add_visuals(link, document_.attributes(child, place.childclass), place.frame);
    }
  }

  /// Returns the surroundings of the elements in a <frame>.
  [[nodiscard]] Place inside(const XmlElement& frame, Place place) const {
    const MjcfAttributes a = document_.attributes(frame, "main");
    const MjcfPose pose = document_.pose(a);
    place.frame = place.frame * pose;
    place.in_body = place.in_body * pose;
    place.childclass = a.text("childclass", place.childclass);
    return place;
  }

  void read_content(const XmlElement& parent, const Place& place, BodyContent& content) const {
    for (const XmlElement* each : document_.children(parent)) {
      const std::string& kind = name_of(*each);
      if (kind == "frame") {
        read_content(*each, inside(*each, place), content);
      } else if (kind == "joint" || kind == "freejoint") {
        content.joints.emplace_back(document_.attributes(*each, place.childclass), place.in_body);
      } else if (kind == "geom") {
        content.geoms.emplace_back(document_.attributes(*each, place.childclass), place.in_body);
      } else if (kind == "inertial") {
        const MjcfAttributes inertial = document_.attributes(*each, "main");
        if (content.inertial) inertial.refuse("the body has two; remove one");
        if (name_of(parent) == "frame") inertial.refuse("it is in a <frame>; put it into the body");
        content.inertial = inertial;
      }
    }
  }

  static std::string type_of(const MjcfAttributes& joint) {
    if (name_of(joint.element()) == "freejoint") return "free";
    const std::string type = joint.text("type", "hinge");
    if (type == "hinge" || type == "slide" || type == "free" || type == "ball") return type;
    joint.refuse(fmt::format("type=\"{:.60}\"; allowed: hinge, slide", type));
  }

  /// Returns whether a hinge or slide joint is in this body or below it.
  [[nodiscard]] bool carries_an_arm(const XmlElement& body, const std::string& around) const {
    for (const XmlElement* each : document_.children(body)) {
      const std::string& kind = name_of(*each);
      if (kind == "joint") {
        const std::string type = type_of(document_.attributes(*each, around));
        if (type == "hinge" || type == "slide") return true;
      } else if (kind == "body" || kind == "frame") {
        const char* const inner = each->Attribute("childclass");
        if (carries_an_arm(*each, inner == nullptr ? around : inner)) return true;
      }
    }
    return false;
  }

  void read_body(const XmlElement& body, const Place& around) {
    const MjcfAttributes a = document_.attributes(body, "main");
    Place place = around;
    place.childclass = a.text("childclass", around.childclass);
    place.in_body = {};
    BodyContent content;
    read_content(body, place, content);
    const bool free = std::ranges::any_of(content.joints, [](const auto& joint) {
      return type_of(joint.first) == "free" || type_of(joint.first) == "ball";
    });
    if (free && !carries_an_arm(body, place.childclass)) return leave_out(body, a);
    const std::string link =
        checked_name(a.text("name", fmt::format("body{}", ++num_bodies_)), links_, body);
    place.moves = place.moves || !content.joints.empty();
    MjcfPose at = around.frame * document_.pose(a);
    place.frame = add_joints(body, link, content, around.link, at);
    place.link = link;
    XmlElement& made = add(robot_, "link", "name", link);
    if (place.moves) add_inertial(made, a, content);
    for (const auto& [geom, frame] : content.geoms) add_visuals(made, geom, frame);
    for (const XmlElement* each : document_.children(body)) read_child(*each, place);
  }

  /// Leaves a free body out of the robot. Its coordinates stay in the keyframe's.
  void leave_out(const XmlElement& body, const MjcfAttributes& a) {
    warn(body, fmt::format("body '{}' is free and carries no joint of the robot; it is left out",
                           a.text("name")));
    count_coordinates(body);
  }
  void count_coordinates(const XmlElement& parent) {
    for (const XmlElement* each : document_.children(parent)) {
      const std::string& kind = name_of(*each);
      if (kind == "freejoint") num_coordinates_ += 7;
      if (kind == "joint") {
        num_coordinates_ += type_of(document_.attributes(*each, "main")) == "ball" ? 4 : 7;
      }
      if (kind == "body" || kind == "frame") count_coordinates(*each);
    }
  }

  /// Returns a name after a check that no other link or joint has it, and that a URDF may have it.
  std::string checked_name(std::string name, std::set<std::string>& taken, const XmlElement& at) {
    if (!is_urdf_name(name)) {
      document_.refuse(at, fmt::format("'{:.60}' is not a name; allowed: up to 200 printable "
                                       "characters, a letter, digit, _ . or / first, no quotes and "
                                       "none of `\\<>&$;|{{}}[],*?!~^%=",
                                       base::printable(name)));
    }
    if (name == world || taken.contains(name)) {
      document_.refuse(at, fmt::format("'{}' is there twice; rename one", name));
    }
    taken.insert(name);
    return name;
  }

  /// Adds the joints of a body, or one that fixes it, with a link between each two of them.
  /// @param at the body's frame in the link `parent`  @return the body's frame in its link
  MjcfPose add_joints(const XmlElement& body, const std::string& link, const BodyContent& content,
                      std::string parent, MjcfPose at) {
    if (content.joints.empty()) {
      add_joint(checked_name(link + "_mount", joints_, body), "fixed", parent, link, at);
      return {};
    }
    Eigen::Vector3d shift = Eigen::Vector3d::Zero();  // of the link's frame in the body's axes
    std::size_t k = 0;
    for (const auto& [joint, frame] : content.joints) {
      const bool last = ++k == content.joints.size();
      const Eigen::Vector3d anchor =
          frame.p + frame.q * joint.vector("pos", Eigen::Vector3d::Zero());
      const bool ends = last && anchor.isZero(0);
      const std::string child =
          ends ? link : checked_name(fmt::format("{}_{}", link, k), links_, body);
      at.p += at.q * (anchor - shift);
      read_joint(joint, frame.q, parent, child, at);
      if (!ends) add(robot_, "link", "name", child);
      parent = child;
      shift = anchor;
      at = {};
    }
    if (parent == link) return {};
    add_joint(checked_name(link + "_mount", joints_, body), "fixed", parent, link,
              {Eigen::Quaterniond::Identity(), -shift});
    return {};
  }

  XmlElement& add_joint(const std::string& name, const char* type, const std::string& parent,
                        const std::string& child, const MjcfPose& at) {
    XmlElement& joint = add(robot_, "joint", "name", name);
    set(joint, "type", type);
    add(joint, "parent", "link", parent);
    add(joint, "child", "link", child);
    add_origin(joint, at);
    return joint;
  }

  /// Adds a joint between two links. @param at the joint's frame where the joint is at `ref`
  void read_joint(const MjcfAttributes& joint, const Eigen::Quaterniond& turned,
                  const std::string& parent, const std::string& child, MjcfPose at) {
    const std::string type = type_of(joint);
    const std::string name =
        checked_name(joint.text("name", child + "_joint"), joints_, joint.element());
    start_at_.emplace_back(name, num_coordinates_);
    num_coordinates_ += type == "free" ? 7 : type == "ball" ? 4 : 1;
    if (type == "free" || type == "ball") {
      add_joint(name, type == "free" ? "floating" : "ball", parent, child, at);
      return;
    }
    const bool hinge = type == "hinge";
    const Eigen::Vector3d axis = turned * joint.vector("axis", Eigen::Vector3d::UnitZ());
    if (axis.norm() < 1e-10) joint.refuse("an axis of length 0; give axis=\"...\"");
    for (const char* spring : {"stiffness", "springdamper"}) {
      const auto given = joint.numbers(spring, 1, 3);
      if (std::ranges::any_of(given, [](double x) { return x != 0; })) {
        joint.refuse(
            fmt::format("{}=\"{}\": a spring is not read; remove it", spring, joint.text(spring)));
      }
    }
    const double unit = hinge ? document_.angle_unit() : 1;
    const double ref = unit * joint.number("ref", 0);
    if (ref != 0) {
      const MjcfPose back =
          hinge ? MjcfPose{rotation_about(axis.normalized(), -ref), Eigen::Vector3d::Zero()}
                : MjcfPose{Eigen::Quaterniond::Identity(), -ref * axis.normalized()};
      at = at * back;
    }
    const auto range = joint.range("range", "limited");
    XmlElement& made = add_joint(name,
                                 !hinge  ? "prismatic"
                                 : range ? "revolute"
                                         : "continuous",
                                 parent, child, at);
    add(made, "axis", "xyz", text_of(axis));
    XmlElement& limit = add(made, "limit");
    if (range) {
      set(limit, "lower", fmt::format("{}", unit * range->first));
      set(limit, "upper", fmt::format("{}", unit * range->second));
    }
    if (const auto effort = drives_.effort_of(joint, name)) {
      set(limit, "effort", fmt::format("{}", *effort));
    }
    XmlElement& dynamics = add(made, "dynamics");
    for (const auto& [ours, theirs] : {std::pair{"damping", "damping"},
                                       {"friction", "frictionloss"},
                                       {"armature", "armature"}}) {
      set(dynamics, ours, fmt::format("{}", joint.coefficient(theirs)));
    }
    moving_[name] = {&made, ref};
  }

  /// Adds the relation q - ref = multiplier (q_other - ref_other) + offset.
  void add_mimic(const std::string& joint, const MjcfMimic& mimic) {
    const auto found = moving_.find(joint), other = moving_.find(mimic.joint);
    if (found == moving_.end() || other == moving_.end()) {
      document_.refuse(*mimic.equality, "a joint that is no hinge or slide; remove the equality");
    }
    XmlElement& made = add(*found->second.element, "mimic", "joint", mimic.joint);
    set(made, "multiplier", fmt::format("{}", mimic.multiplier));
    const double offset = found->second.ref + mimic.offset - mimic.multiplier * other->second.ref;
    set(made, "offset", fmt::format("{}", offset));
  }

  /// Adds the mass of a body that moves: its <inertial>, or its geoms where <compiler> takes these.
  void add_inertial(XmlElement& link, const MjcfAttributes& body, const BodyContent& content) {
    const std::string from_geom = document_.compiler().text("inertiafromgeom", "auto");
    MassProperties mass;
    if (content.inertial && from_geom != "true") {
      mass = mass_of_inertial(document_, *content.inertial);
    } else if (from_geom != "false") {
      for (const auto& [geom, frame] : content.geoms) {
        if (!has_mass(document_, geom)) continue;
        MassProperties each = mass_of_geom(document_, geom);
        each.p_Bcm = frame.p + frame.q * each.p_Bcm;
        each.I_Bcm = rotated(each.I_Bcm, frame.q.toRotationMatrix());
        mass = combine(mass, each);
      }
    }
    mass = corrected(document_, mass);
    if (mass.mass == 0 && mass.I_Bcm.isZero(0)) return;
    gravcomp_.emplace_back(document_.where(body.element()), body.number("gravcomp", 0));
    XmlElement& inertial = add(link, "inertial");
    add(inertial, "origin", "xyz", text_of(mass.p_Bcm));
    add(inertial, "mass", "value", fmt::format("{}", mass.mass));
    add_inertia(inertial, mass.I_Bcm);
  }

  /// Adds the pictures of a geom in the groups that MuJoCo shows at first.
  void add_visuals(XmlElement& link, const MjcfAttributes& geom, const MjcfPose& frame) {
    constexpr double last_shown = 2;
    if (geom.number("group", 0) > last_shown) return;
    const MjcfShape shape = shape_of(document_, geom);
    const MjcfPose at = frame * shape.pose;
    const Eigen::Vector3d& size = shape.size;
    const auto drawn = [&](const MjcfPose& where, const char* kind, const char* attribute,
                           const std::string& value) -> XmlElement& {
      XmlElement& visual = add(link, "visual");
      add_origin(visual, where);
      XmlElement& geometry = add(visual, "geometry");
      const auto colour = colours_.find(geom.text("material"));
      const std::string rgba = geom.text("rgba", colour == colours_.end() ? "" : colour->second);
      if (!rgba.empty()) add(add(visual, "material", "name", ""), "color", "rgba", rgba);
      return add(geometry, kind, attribute, value);
    };
    if (geom.has("mesh")) {
      const auto mesh = meshes_.find(geom.text("mesh"));
      if (mesh == meshes_.end()) return;
      XmlElement& element = drawn(at, "mesh", "filename", mesh->second.filename);
      if (!mesh->second.scale.empty()) set(element, "scale", mesh->second.scale);
    } else if (shape.type == "box") {
      drawn(at, "box", "size", text_of(2 * size));
    } else if (shape.type == "sphere") {
      drawn(at, "sphere", "radius", fmt::format("{}", size[0]));
    } else if (shape.type == "cylinder" || shape.type == "capsule") {
      XmlElement& cylinder = drawn(at, "cylinder", "radius", fmt::format("{}", size[0]));
      set(cylinder, "length", fmt::format("{}", 2 * size[1]));
      if (shape.type == "cylinder") return;
      for (const double end : {-size[1], size[1]}) {
        drawn(at * MjcfPose{Eigen::Quaterniond::Identity(), {0, 0, end}}, "sphere", "radius",
              fmt::format("{}", size[0]));
      }
    }
  }

  /// Reads the posture of the keyframe "home", or else of the first.
  void read_keyframe() {
    std::optional<MjcfAttributes> chosen;
    for (const XmlElement* each : document_.in_sections("keyframe")) {
      if (name_of(*each) != "key") {
        document_.refuse(*each, "<keyframe> has <key> alone; remove the element");
      }
      const MjcfAttributes key = document_.attributes(*each, "main");
      if (key.has("qpos") && (!chosen || key.text("name") == "home")) chosen = key;
    }
    if (!chosen) return;
    const auto qpos = chosen->numbers("qpos", num_coordinates_, num_coordinates_);
    for (const auto& [joint, at] : start_at_) made_.start[joint] = qpos[at];
  }

  /// Notes whether the simulator carries the whole weight. Warns where it carries a part of it.
  void compare_gravcomp() {
    const auto full = [](const auto& each) { return each.second == 1; };
    const auto none = [](const auto& each) { return each.second == 0; };
    made_.adds_gravity = !gravcomp_.empty() && std::ranges::all_of(gravcomp_, full);
    if (made_.adds_gravity || std::ranges::all_of(gravcomp_, none)) return;
    const auto part = std::ranges::find_if_not(gravcomp_, none);
    made_.warnings.push_back(
        fmt::format("{}: gravcomp=\"{}\" is not read: not all bodies that move have 1", part->first,
                    part->second));
  }

  MjcfDocument document_;
  MjcfDrives drives_;
  XmlDocument urdf_;
  XmlElement& robot_ = add(urdf_, "robot");
  Description made_;
  std::map<std::string, Mesh> meshes_;          ///< by asset's name
  std::map<std::string, std::string> colours_;  ///< rgba by material
  std::set<std::string> links_, joints_;
  std::map<std::string, Moving> moving_;                       ///< hinges and slides
  std::vector<std::pair<std::string, std::size_t>> start_at_;  ///< place of joints in qpos
  std::vector<std::pair<std::string, double>> gravcomp_;       ///< place and value of each body
  std::size_t num_coordinates_ = 0;                            ///< of qpos
  int num_bodies_ = 0;
};

}  // namespace

bool is_mjcf(std::string_view text) {
  for (std::size_t at = text.find('<'); at != std::string_view::npos; at = text.find('<', at + 1)) {
    std::string_view rest = text.substr(at);
    if (rest.starts_with("<!--")) {
      at = text.find("-->", at);
      if (at == std::string_view::npos) return false;
    } else if (!rest.starts_with("<?") && !rest.starts_with("<!")) {
      constexpr std::string_view root = "<mujoco";
      return rest.starts_with(root) && rest.size() > root.size() &&
             std::string_view(" \t\r\n/>").find(rest[root.size()]) != std::string_view::npos;
    }
  }
  return false;
}

Description description_of_mjcf(const std::string& text, const std::string& source,
                                const IncludedText& included) {
  return Converter(text, source, included).description();
}

}  // namespace tachless::robot
