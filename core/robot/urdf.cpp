#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/elementary.h"
#include "robot/model.h"
#include "robot/urdf_xml.h"

namespace tachless::robot {
namespace {

class Loader {
 public:
  Loader(UrdfTree tree, const std::string& source, const UrdfOptions& options)
      : source_(source), options_(options), urdf_(std::move(tree)) {
    model_.warnings = urdf_.warnings;
  }

  Model load() {
    check_locked();
    for (const auto& [name, joint] : urdf_.joints) relations_[name] = resolve_mimic(joint);
    check_joints();
    add_links();
    name_coordinates();
    check_bodies();
    return std::move(model_);
  }

 private:
  template <class... Args>
  [[noreturn]] void refuse(fmt::format_string<Args...> text, Args&&... args) const {
    refuse_urdf(source_, fmt::format(text, std::forward<Args>(args)...));
  }
  template <class... Args>
  void warn(fmt::format_string<Args...> text, Args&&... args) {
    model_.warnings.push_back(source_ + ": " + fmt::format(text, std::forward<Args>(args)...));
  }

  /// Returns the position of a joint that is fixed, locked, or mimics such a joint. Returns nothing
  /// for a joint that moves.
  std::optional<double> held(const UrdfJoint& joint) const {
    const MimicRelation& drive = relations_.at(joint.name);
    if (const auto lock = options_.locked.find(drive.joint); lock != options_.locked.end()) {
      return drive.multiplier * lock->second + drive.offset;
    }
    if (urdf_.joints.at(drive.joint).fixed) return drive.offset;
    return std::nullopt;
  }
  bool independent(const UrdfJoint& joint) const { return !joint.mimic && !held(joint); }

  /// Refuses an offset beyond 10 km. Rounding there removes the body's own inertia.
  void require_near(const std::string& what, const Eigen::Vector3d& offset) const {
    constexpr double farthest_m = 1e4;
    if (offset.norm() <= farthest_m) return;
    refuse("{} is {:g} m away; allowed: up to {:g} m (is it in another unit?)", what, offset.norm(),
           farthest_m);
  }

  void check_locked() const {
    for (const auto& [name, position] : options_.locked) {
      const auto found = urdf_.joints.find(name);
      if (found == urdf_.joints.end()) {
        std::vector<std::string> names;
        for (const auto& [known, unused] : urdf_.joints) names.push_back(known);
        refuse("robot.locked: there is no joint '{}'; its joints are {}", name,
               fmt::join(names, ", "));
      }
      const UrdfJoint& joint = found->second;
      if (joint.fixed && position != 0) {
        refuse("robot.locked: joint '{}' is fixed; leave it out", name);
      }
      if (joint.has_range && joint.lower <= joint.upper &&
          (position < joint.lower || position > joint.upper)) {
        refuse("robot.locked: {} of joint '{}' is outside its limits [{}, {}]", position, name,
               joint.lower, joint.upper);
      }
    }
  }

  void check_joints() {
    std::vector<const UrdfJoint*> closed;
    for (const auto& [name, joint] : urdf_.joints) {
      const std::string where = "joint '" + name + "'";
      require_near(where + ": origin", joint.p);
      if (joint.mimic) warn_of_mimic(joint, where);
      if (joint.fixed) continue;
      if (joint.axis.norm() < 1e-9) {
        refuse("{}: axis {} has no direction; give a vector of length 1", where,
               fmt::join(joint.axis, " "));
      }
      if (joint.has_range && joint.lower >= joint.upper && independent(joint)) {
        closed.push_back(&joint);
      }
    }
    if (!closed.empty()) refuse_closed(closed);
  }

  /// Refuses these joints in one message, with the line that fixes them.
  [[noreturn]] void refuse_closed(const std::vector<const UrdfJoint*>& joints) const {
    std::vector<std::string> limits, locked;
    bool revolute = false;
    for (const UrdfJoint* joint : joints) {
      limits.push_back(
          fmt::format("'{}' (lower {}, upper {})", joint->name, joint->lower, joint->upper));
      locked.push_back(fmt::format("{}: {}", joint->name, joint->lower));
      revolute = revolute || joint->type == JointType::revolute;
    }
    refuse(
        "joint {}: limits leave no room; give lower < upper{}, or fix {} in the scenario: "
        "robot.locked: {{{}}}",
        fmt::join(limits, ", "), revolute ? ", or type continuous" : "",
        joints.size() == 1 ? "it" : "them", fmt::join(locked, ", "));
  }

  void warn_of_mimic(const UrdfJoint& joint, const std::string& where) {
    const std::string& other = joint.mimic->joint;
    if (joint.fixed) {
      warn("{} is fixed; that it mimics '{}' has no effect", where, other);
    } else if (const auto position = held(joint);
               position && options_.locked.count(joint.name) == 0) {
      warn("{} mimics '{}', which does not move; it is held at {}", where, other, *position);
    }
  }

  /// Follows a chain of mimics to the independent joint that drives it.
  MimicRelation resolve_mimic(const UrdfJoint& joint) const {
    MimicRelation drive{joint.name};
    std::set<std::string> seen;
    const UrdfJoint* at = &joint;
    while (at->mimic && !at->fixed && options_.locked.count(at->name) == 0) {
      const MimicRelation& mimic = *at->mimic;
      if (!seen.insert(at->name).second) {
        refuse(
            "joint '{}': mimics itself by way of '{}'; let one joint of the cycle be independent",
            at->name, mimic.joint);
      }
      if (seen.size() > max_bodies) {
        refuse(
            "joint '{}': mimics by way of more than {} joints; let it mimic an independent joint",
            joint.name, max_bodies);
      }
      const auto next = urdf_.joints.find(mimic.joint);
      if (next == urdf_.joints.end()) {
        refuse("joint '{}': mimics joint '{}', which does not exist; correct the name", at->name,
               mimic.joint);
      }
      drive.offset += drive.multiplier * mimic.offset;
      drive.multiplier *= mimic.multiplier;
      drive.joint = mimic.joint;
      at = &next->second;
    }
    return drive;
  }

  /// Adds a link to the body of its frame. Remembers an inertia that no body can have;
  /// `check_bodies` judges the merged body.
  void add_link(const std::string& name, const Frame& frame) {
    model_.frames[name] = frame;
    if (frame.body < 0) return;
    const UrdfLink& link = urdf_.links.at(name);
    MassProperties mass = link.mass;
    require_near("link '" + name + "': inertial origin", mass.p_Bcm);
    if (const std::string why = why_not_physical(mass); !why.empty()) {
      impossible_[frame.body].push_back("link '" + name + "': " + why);
    }
    if (mass.mass == 0 && mass.I_Bcm.isZero(0)) return;
    mass.p_Bcm = frame.p_BF + frame.R_BF * mass.p_Bcm;
    mass.I_Bcm = rotated(rotated(mass.I_Bcm, link.R), frame.R_BF);
    MassProperties& body = model_.bodies[static_cast<std::size_t>(frame.body)];
    body = combine(body, mass);
  }

  void add_links() {
    add_link(urdf_.root, {-1, rotation_of(options_.base_rpy), options_.base_xyz, true});
    for (const std::string& name : urdf_.order) {
      const UrdfJoint& joint = urdf_.joints.at(name);
      Frame& parent = model_.frames.at(joint.parent);
      parent.leaf = false;
      Frame frame = parent;
      frame.leaf = true;
      frame.R_BF = parent.R_BF * joint.R;
      frame.p_BF = parent.p_BF + parent.R_BF * joint.p;
      if (const std::optional<double> position = held(joint)) {
        hold(joint, *position, frame);
      } else {
        frame = {add_body(joint, frame), Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero(),
                 true};
      }
      add_link(joint.child, frame);
    }
    if (model_.num_joints == 0) refuse("no joint moves; a robot needs at least one");
  }

  /// Moves the joint's `frame` by the position at which the joint is held.
  static void hold(const UrdfJoint& joint, double position, Frame& frame) {
    if (joint.fixed || position == 0) return;
    const Eigen::Vector3d axis = joint.axis.normalized();
    if (joint.type == JointType::prismatic) {
      frame.p_BF += frame.R_BF * axis * position;
    } else {
      double s = 0, c = 0;
      base::sin_cos(position / 2, s, c);
      const Eigen::Quaterniond turned(c, s * axis.x(), s * axis.y(), s * axis.z());
      frame.R_BF = frame.R_BF * turned.toRotationMatrix();
    }
  }

  /// Appends the body that `joint` moves, in its parent's `frame`; returns its index.
  int add_body(const UrdfJoint& joint, const Frame& frame) {
    if (model_.bodies.size() == max_bodies) {
      refuse("joint '{}': more than {} moving bodies; merge some by fixed joints", joint.name,
             max_bodies);
    }
    Body body;
    body.link = joint.child;
    body.joint = joint.name;
    body.parent = frame.body;
    body.type = joint.type;
    body.R_PB = frame.R_BF;
    body.p_PB = frame.p_BF;
    body.axis_B = joint.axis;
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

  /// Names the coordinates. Runs after `add_links`, because a joint may mimic a later one.
  void name_coordinates() {
    const int n = model_.num_joints;
    model_.joint_names.resize(n);
    model_.joint_types.resize(n);
    model_.lower = Vector::Constant(n, -Model::unlimited);
    model_.upper = model_.effort_limit = model_.velocity_limit = -model_.lower;
    model_.deceleration_limit = -model_.lower;
    model_.rotor_inertia = model_.damping = model_.friction = Vector::Zero(n);
    model_.velocity_offset = Vector::Zero(n);
    for (Body& body : model_.bodies) {
      const UrdfJoint& joint = urdf_.joints.at(body.joint);
      const MimicRelation& drive = relations_.at(joint.name);
      const int j = coordinate_.at(drive.joint);
      body.coordinate = j;
      body.multiplier = drive.multiplier;
      body.offset = drive.offset;
      // The joint has velocity m v. Its damping d has the power d m^2 v^2, its friction f the power
      // f |m| |v|, its rotor a the energy a m^2 v^2 / 2.
      const double m = drive.multiplier;
      model_.damping[j] += m * m * loss(joint, "damping", joint.damping);
      model_.friction[j] += std::abs(m) * loss(joint, "friction", joint.friction);
      model_.rotor_inertia[j] += m * m * loss(joint, "armature", joint.armature);
      if (!independent(joint)) continue;
      model_.joint_names[j] = joint.name;
      model_.joint_types[j] = body.type;
      model_.effort_limit[j] = limit_or_none(joint, "effort", joint.effort);
      if (joint.deceleration_limit > 0) model_.deceleration_limit[j] = joint.deceleration_limit;
      model_.velocity_offset[j] = joint.velocity_offset;
      narrow(body);
    }
    for (const Body& body : model_.bodies) {
      if (urdf_.joints.at(body.joint).mimic) narrow(body);
    }
  }

  /// Narrows the limits of the joint that drives a body by the limits of the body's own joint.
  void narrow(const Body& body) {
    const UrdfJoint& joint = urdf_.joints.at(body.joint);
    const int j = body.coordinate;
    const double m = body.multiplier;
    if (m == 0) return;
    // A difference below rounding does not count, so an equal limit keeps the driver's digits.
    const auto less = [](double a, double b) { return a < b - 1e-6 * std::abs(a) - 1e-9; };
    const double speed = limit_or_none(joint, "velocity", joint.velocity) / std::abs(m);
    if (less(speed, model_.velocity_limit[j])) model_.velocity_limit[j] = speed;
    if (!joint.has_range || joint.lower >= joint.upper) return;
    const auto [low, high] =
        std::minmax({(joint.lower - body.offset) / m, (joint.upper - body.offset) / m});
    if (std::max(low, model_.lower[j]) >= std::min(high, model_.upper[j])) {
      return warn("joint '{}': its limits leave joint '{}' no room; they are not used", joint.name,
                  model_.joint_names[j]);
    }
    if (less(-low, -model_.lower[j])) model_.lower[j] = low;
    if (less(high, model_.upper[j])) model_.upper[j] = high;
  }

  double limit_or_none(const UrdfJoint& joint, const char* what, double value) {
    if (value < 0) warn("joint '{}': {} limit {} is taken for none", joint.name, what, value);
    return value > 0 ? value : Model::unlimited;
  }

  double loss(const UrdfJoint& joint, const char* what, double value) {
    if (value >= 0) return value;
    warn("joint '{}': {} {} would drive the joint; it is not used", joint.name, what, value);
    return 0;
  }

  /// Checks the bodies after merging.
  void check_bodies() {
    std::vector<std::string> offenders;
    for (std::size_t i = 0; i < model_.bodies.size(); ++i) {
      const Body& body = model_.bodies[i];
      const std::string why = why_not_physical(body);
      if (body.mass < 0) refuse("link '{}' with what is fixed to it: {}", body.link, why);
      const auto& links = impossible_[static_cast<int>(i)];
      if (why.empty()) {
        for (const std::string& link : links) {
          warn("{} (merged into the body of joint '{}', which is possible)", link, body.joint);
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
    for (const std::string& offender : offenders) warn("{}", offender);
  }

  const std::string& source_;
  const UrdfOptions& options_;
  const UrdfTree urdf_;
  std::map<std::string, MimicRelation> relations_;  ///< relation of a joint to its driver
  std::map<std::string, int> coordinate_;
  std::map<int, std::vector<std::string>> impossible_;  ///< by body: faults of its links
  Model model_;
};

}  // namespace

Model read_urdf(const std::string& text, const std::string& source, const UrdfOptions& options) {
  return model_of(read_urdf_xml(text, source, options.locked), source, options);
}

Model model_of(UrdfTree tree, const std::string& source, const UrdfOptions& options) {
  return Loader(std::move(tree), source, options).load();
}

}  // namespace tachless::robot
