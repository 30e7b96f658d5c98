#include <fmt/format.h>

#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "robot/mass_properties.h"
#include "robot/model.h"
#include "robot/positive_inertia.h"
#include "robot/urdf_tree.h"
#include "robot/urdfdom.h"

namespace tachless::robot {
namespace {

Eigen::Vector3d vector_of(const urdf::Vector3& v) { return {v.x, v.y, v.z}; }
Eigen::Matrix3d rotation_of(const urdf::Rotation& r) {
  return Eigen::Quaterniond(r.w, r.x, r.y, r.z).toRotationMatrix();
}

/// Roll, pitch, yaw; exactly 1 for zeros.
Eigen::Matrix3d rotation_of(const Eigen::Vector3d& rpy) {
  urdf::Rotation r;
  r.setFromRPY(rpy[0], rpy[1], rpy[2]);
  return rotation_of(r);
}

/// Coordinate and affine map of a joint: q_tree = multiplier q + offset.
struct Drive {
  std::string joint;  ///< the independent joint at the end of the mimic chain
  double multiplier = 1, offset = 0;
};

class Loader {
 public:
  Loader(const std::string& text, const std::string& source, const UrdfOptions& options)
      : source_(source), options_(options), xml_(read_urdf_xml(text, source, options.locked)) {
    model_.warnings = xml_.warnings;
    urdf_ = parse_with_urdfdom(xml_.text, source);
  }

  Model load() {
    check_locked();
    check_joints();
    walk();
    name_coordinates();
    check_bodies();
    return std::move(model_);
  }

 private:
  template <class... Args>
  [[noreturn]] void refuse(fmt::format_string<Args...> text, Args&&... args) const {
    refuse_urdf(source_, fmt::format(text, std::forward<Args>(args)...));
  }

  void warn(const std::string& what) { model_.warnings.push_back(source_ + ": " + what); }
  /// Where a joint is held that is fixed, locked, or mimics one that is; nothing: it moves.
  std::optional<double> held(const urdf::Joint& joint) const {
    const Drive drive = drive_of(joint);
    if (const auto lock = options_.locked.find(drive.joint); lock != options_.locked.end()) {
      return drive.multiplier * lock->second + drive.offset;
    }
    if (urdf_->getJoint(drive.joint)->type == urdf::Joint::FIXED) return drive.offset;
    return std::nullopt;
  }
  bool moves(const urdf::Joint& joint) const { return !held(joint); }
  bool independent(const urdf::Joint& joint) const { return !joint.mimic && moves(joint); }

  /// The joints below a link, in the order of the file.
  std::vector<const urdf::Joint*> joints_below(const std::string& link) const {
    std::vector<const urdf::Joint*> joints;
    const auto found = xml_.joints_below.find(link);
    if (found == xml_.joints_below.end()) return joints;
    joints.reserve(found->second.size());
    for (const std::string& name : found->second) joints.push_back(urdf_->getJoint(name).get());
    return joints;
  }

  /// Farther away, an inertia about a joint has no digit of the body's own left.
  void require_near(const std::string& what, const Eigen::Vector3d& offset) const {
    constexpr double farthest_m = 1e4;
    if (offset.norm() <= farthest_m) return;
    refuse("{} is {:g} m away; allowed: up to {:g} m (is it in another unit?)", what, offset.norm(),
           farthest_m);
  }

  void check_locked() const {
    for (const auto& [name, position] : options_.locked) {
      const auto joint = urdf_->getJoint(name);
      if (!joint) {
        std::vector<std::string> names;
        names.reserve(urdf_->joints_.size());
        for (const auto& [known, unused] : urdf_->joints_) names.push_back(known);
        refuse("robot.locked: there is no joint '{}'; its joints are {}", name,
               fmt::join(names, ", "));
      }
      if (joint->type == urdf::Joint::FIXED && position != 0) {
        refuse("robot.locked: joint '{}' is fixed; leave it out", name);
      }
      if (!joint->limits || joint->type == urdf::Joint::CONTINUOUS || !has_range(*joint)) continue;
      const urdf::JointLimits& limits = *joint->limits;
      if (limits.lower <= limits.upper && (position < limits.lower || position > limits.upper)) {
        refuse("robot.locked: {} of joint '{}' is outside its limits [{}, {}]", position, name,
               limits.lower, limits.upper);
      }
    }
  }

  void check_joints() {
    for (const auto& [name, joint] : urdf_->joints_) {
      const std::string where = "joint '" + name + "'";
      const urdf::Pose& X = joint->parent_to_joint_origin_transform;
      if (!vector_of(X.position).allFinite() || !rotation_of(X.rotation).allFinite()) {
        refuse("{}: origin is not finite; give finite numbers", where);
      }
      require_near(where + ": origin", vector_of(X.position));
      if (joint->mimic) warn_of_mimic(*joint, where);
      if (joint->type == urdf::Joint::FIXED) continue;
      const Eigen::Vector3d axis = vector_of(joint->axis);
      if (!axis.allFinite() || axis.norm() < 1e-9) {
        refuse("{}: axis {} has no direction; give a vector of length 1", where,
               fmt::join(axis, " "));
      }
      if (independent(*joint) && has_range(*joint)) check_limits(*joint, where);
    }
  }

  void warn_of_mimic(const urdf::Joint& joint, const std::string& where) {
    const std::string& other = joint.mimic->joint_name;
    if (joint.type == urdf::Joint::FIXED) {
      warn(where + " is fixed; that it mimics '" + other + "' has no effect");
    } else if (const auto position = held(joint);
               position && options_.locked.count(joint.name) == 0) {
      warn(fmt::format("{} mimics '{}', which does not move; it is held at {}", where, other,
                       *position));
    }
  }

  bool has_range(const urdf::Joint& joint) const {
    return joint.type != urdf::Joint::CONTINUOUS &&
           xml_.joints_without_range.count(joint.name) == 0;
  }

  void check_limits(const urdf::Joint& joint, const std::string& where) const {
    const urdf::JointLimits& limits = *joint.limits;
    if (std::isfinite(limits.lower) && std::isfinite(limits.upper) && limits.lower < limits.upper) {
      return;
    }
    refuse("{}: limits lower {}, upper {} leave no room; give lower < upper{}{}", where,
           limits.lower, limits.upper,
           joint.type == urdf::Joint::REVOLUTE ? ", or type continuous" : "",
           fmt::format(", or fix it in the scenario: robot.locked: {{{}: {}}}", joint.name,
                       limits.lower));
  }

  /// Follows a chain of mimics to the independent joint that drives it.
  Drive drive_of(const urdf::Joint& joint) const {
    Drive drive{joint.name};
    std::set<std::string> seen;
    const urdf::Joint* at = &joint;
    while (at->mimic && at->type != urdf::Joint::FIXED && options_.locked.count(at->name) == 0) {
      const urdf::JointMimic& mimic = *at->mimic;
      const std::string where = "joint '" + at->name + "'";
      if (!std::isfinite(mimic.multiplier) || !std::isfinite(mimic.offset)) {
        refuse("{}: mimic multiplier {} and offset {} must be finite", where, mimic.multiplier,
               mimic.offset);
      }
      if (!seen.insert(at->name).second) {
        refuse("{}: mimics itself by way of '{}'; let one joint of the cycle be independent", where,
               mimic.joint_name);
      }
      const auto next = urdf_->getJoint(mimic.joint_name);
      if (!next) {
        refuse("{}: mimics joint '{}', which does not exist; correct the name", where,
               mimic.joint_name);
      }
      drive.offset += drive.multiplier * mimic.offset;
      drive.multiplier *= mimic.multiplier;
      drive.joint = next->name;
      at = next.get();
    }
    return drive;
  }

  /// A link's mass properties in its own frame. What no body can have is remembered: the body
  /// that it is merged into is judged.
  MassProperties mass_of(const urdf::Link& link, int body) {
    if (!link.inertial) return {};
    const urdf::Inertial& in = *link.inertial;
    const Eigen::Matrix3d R = rotation_of(in.origin.rotation);
    Eigen::Matrix3d I;
    I << in.ixx, in.ixy, in.ixz, in.ixy, in.iyy, in.iyz, in.ixz, in.iyz, in.izz;
    MassProperties mass{in.mass, vector_of(in.origin.position), I};
    if (!R.allFinite() || !mass.p_cm.allFinite() || !I.allFinite() || !std::isfinite(mass.mass)) {
      refuse("link '{}': <inertial> is not finite; give finite numbers", link.name);
    }
    require_near("link '" + link.name + "': inertial origin", mass.p_cm);
    if (const std::string why = why_not_physical(mass); !why.empty()) {
      impossible_[body].push_back("link '" + link.name + "': " + why);
    }
    mass.I_cm = rotated(I, R);
    return mass;
  }

  void add_link(const std::string& name, const Frame& frame) {
    const urdf::Link& link = *urdf_->getLink(name);
    Frame& kept = model_.frames[name] = frame;
    kept.leaf = joints_below(name).empty();
    if (frame.body < 0) return;
    MassProperties mass = mass_of(link, frame.body);
    if (mass.mass == 0 && mass.I_cm.isZero(0)) return;
    mass.p_cm = frame.p_BF + frame.R_BF * mass.p_cm;
    mass.I_cm = rotated(mass.I_cm, frame.R_BF);
    Body& body = model_.bodies[frame.body];
    const MassProperties both = combine({body.mass, body.p_Bcm, body.I_Bcm}, mass);
    body.mass = both.mass;
    body.p_Bcm = both.p_cm;
    body.I_Bcm = both.I_cm;
  }

  /// Depth-first; a stack of its own, since nothing bounds a chain of fixed links.
  void walk() {
    const std::string root = urdf_->getRoot()->name;
    Frame ground;
    ground.R_BF = rotation_of(options_.base_rpy);
    ground.p_BF = options_.base_xyz;
    add_link(root, ground);
    std::vector<const urdf::Joint*> stack;
    const auto push_below = [&](const std::string& link) {
      const auto joints = joints_below(link);
      stack.insert(stack.end(), joints.rbegin(), joints.rend());
    };
    push_below(root);
    while (!stack.empty()) {
      const urdf::Joint& joint = *stack.back();
      stack.pop_back();
      const Frame& parent = model_.frames.at(joint.parent_link_name);
      const urdf::Pose& X = joint.parent_to_joint_origin_transform;
      Frame frame;
      frame.body = parent.body;
      frame.R_BF = parent.R_BF * rotation_of(X.rotation);
      frame.p_BF = parent.p_BF + parent.R_BF * vector_of(X.position);
      if (const std::optional<double> position = held(joint); position) {
        hold(joint, *position, frame);
      } else {
        const int body = add_body(joint, frame);
        frame = Frame{};
        frame.body = body;
      }
      add_link(joint.child_link_name, frame);
      push_below(joint.child_link_name);
    }
    if (model_.num_joints == 0) refuse("no joint moves; a robot needs at least one");
  }

  /// Moves `frame`, the joint's, to where the joint is held.
  static void hold(const urdf::Joint& joint, double position, Frame& frame) {
    if (joint.type == urdf::Joint::FIXED || position == 0) return;
    const Eigen::Vector3d axis = vector_of(joint.axis).normalized();
    if (joint.type == urdf::Joint::PRISMATIC) {
      frame.p_BF += frame.R_BF * axis * position;
    } else {
      frame.R_BF = frame.R_BF * Eigen::AngleAxisd(position, axis).toRotationMatrix();
    }
  }

  /// Appends the body that `joint` moves, in its parent's `frame`; returns its index.
  int add_body(const urdf::Joint& joint, const Frame& frame) {
    if (model_.bodies.size() == max_bodies) {
      refuse("joint '{}': more than {} moving bodies; merge some by fixed joints", joint.name,
             max_bodies);
    }
    Body body;
    body.link = joint.child_link_name;
    body.joint = joint.name;
    body.parent = frame.body;
    body.type = joint.type == urdf::Joint::PRISMATIC ? JointType::prismatic : JointType::revolute;
    body.R_PB = frame.R_BF;
    body.p_PB = frame.p_BF;
    body.axis_B = vector_of(joint.axis);
    if (const double length = body.axis_B.norm(); length != 1) body.axis_B /= length;
    if (independent(joint)) {
      if (model_.num_joints == max_joints) {
        refuse("joint '{}': more than {} joints; fix some, in the scenario by robot.locked",
               joint.name, max_joints);
      }
      coordinate_[joint.name] = model_.num_joints++;
    }
    model_.bodies.push_back(body);
    return static_cast<int>(model_.bodies.size()) - 1;
  }

  /// Coordinates are known only after the walk: a joint may mimic one that comes later.
  void name_coordinates() {
    const int n = model_.num_joints;
    model_.joint_names.resize(n);
    model_.joint_types.resize(n);
    model_.lower = Vector::Constant(n, -Model::unlimited);
    model_.upper = Vector::Constant(n, Model::unlimited);
    model_.effort_limit = Vector::Constant(n, Model::unlimited);
    model_.velocity_limit = Vector::Constant(n, Model::unlimited);
    model_.rotor_inertia = Vector::Zero(n);
    model_.damping = Vector::Zero(n);
    model_.friction = Vector::Zero(n);
    for (Body& body : model_.bodies) {
      const urdf::Joint& joint = *urdf_->getJoint(body.joint);
      const Drive drive = drive_of(joint);
      const int j = coordinate_.at(drive.joint);
      body.coordinate = j;
      body.multiplier = drive.multiplier;
      body.offset = drive.offset;
      add_dynamics(joint, drive.multiplier, j);
      if (!independent(joint)) continue;
      model_.joint_names[j] = joint.name;
      model_.joint_types[j] = body.type;
      if (!joint.limits) continue;
      if (has_range(joint)) {
        model_.lower[j] = joint.limits->lower;
        model_.upper[j] = joint.limits->upper;
      }
      model_.effort_limit[j] = limit_or_none(joint, "effort", joint.limits->effort);
      model_.velocity_limit[j] = limit_or_none(joint, "velocity", joint.limits->velocity);
    }
  }

  double limit_or_none(const urdf::Joint& joint, const char* what, double value) {
    if (value < 0) {
      warn(fmt::format("joint '{}': {} limit {} is taken for none", joint.name, what, value));
    }
    return value > 0 ? value : Model::unlimited;
  }

  /// The power of damping d and friction f of a mimic joint, whose velocity is m v, in terms of v:
  /// d m^2 v^2 and f |m| |v|.
  void add_dynamics(const urdf::Joint& joint, double multiplier, int coordinate) {
    if (!joint.dynamics) return;
    const auto usable = [&](const char* what, double value) {
      if (std::isfinite(value) && value >= 0) return value;
      warn(fmt::format("joint '{}': {} {} would drive the joint; it is not used", joint.name, what,
                       value));
      return 0.0;
    };
    model_.damping[coordinate] +=
        multiplier * multiplier * usable("damping", joint.dynamics->damping);
    model_.friction[coordinate] +=
        std::abs(multiplier) * usable("friction", joint.dynamics->friction);
  }

  /// Of bodies as they are after merging.
  void check_bodies() {
    std::vector<std::string> offenders;
    for (std::size_t i = 0; i < model_.bodies.size(); ++i) {
      const Body& body = model_.bodies[i];
      const std::string why = why_not_physical({body.mass, body.p_Bcm, body.I_Bcm});
      if (body.mass < 0) refuse("link '{}' with what is fixed to it: {}", body.link, why);
      const auto& links = impossible_[static_cast<int>(i)];
      if (why.empty()) {
        for (const std::string& link : links) {
          warn(link +
               fmt::format(" (merged into the body of joint '{}', which is possible)", body.joint));
        }
      } else if (links.size() == 1) {
        offenders.push_back(links.front());
      } else {
        offenders.push_back(fmt::format("link '{}' with what is fixed to it: {}", body.link, why));
      }
    }
    if (offenders.empty()) return;
    if (options_.check_inertia == CheckInertia::refuse) {
      const std::vector<std::string> joints = joints_without_inertia(model_);
      refuse("{}; {}", fmt::join(offenders, "; "),
             !joints.empty()
                 ? fmt::format("and joint '{}' moves no inertia", fmt::join(joints, "', '"))
                 : "or, as the inertia matrix is positive definite, robot.check_inertia: warn");
    }
    for (const std::string& offender : offenders) warn(offender);
  }

  std::string source_;
  UrdfOptions options_;
  UrdfXml xml_;
  urdf::ModelInterfaceSharedPtr urdf_;
  std::map<std::string, int> coordinate_;
  std::map<int, std::vector<std::string>> impossible_;  ///< by body: what its links have
  Model model_;
};

}  // namespace

Model read_urdf(const std::string& text, const std::string& source, const UrdfOptions& options) {
  return Loader(text, source, options).load();
}

}  // namespace tachless::robot
