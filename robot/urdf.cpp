#include <console_bridge/console.h>
#include <fmt/format.h>
#include <urdf_parser/urdf_parser.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <exception>
#include <map>
#include <mutex>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "robot/cholesky.h"
#include "robot/mass_matrix.h"
#include "robot/mass_properties.h"
#include "robot/model.h"
#include "robot/urdf_tree.h"

namespace tachless::robot {
namespace {

/// While it lives, what urdfdom would print is kept instead. One at a time: urdfdom's channel is
/// global.
class UrdfdomMessages : public console_bridge::OutputHandler {
 public:
  UrdfdomMessages() : lock_(mutex()), level_(console_bridge::getLogLevel()) {
    console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_ERROR);
    console_bridge::useOutputHandler(this);
  }
  ~UrdfdomMessages() override {
    console_bridge::restorePreviousOutputHandler();
    console_bridge::setLogLevel(level_);
  }
  void log(const std::string& message, console_bridge::LogLevel, const char*, int) override {
    text += (text.empty() ? "" : "; ") + message;
  }

  std::string text;

 private:
  static std::mutex& mutex() {
    static std::mutex m;
    return m;
  }
  std::lock_guard<std::mutex> lock_;
  console_bridge::LogLevel level_;
};

Eigen::Vector3d vector_of(const urdf::Vector3& v) { return {v.x, v.y, v.z}; }
Eigen::Matrix3d rotation_of(const urdf::Rotation& r) {
  return Eigen::Quaterniond(r.w, r.x, r.y, r.z).toRotationMatrix();
}

/// Coordinate and affine map of a joint: q_tree = multiplier q + offset.
struct Drive {
  std::string joint;  ///< the independent joint at the end of the mimic chain
  double multiplier = 1, offset = 0;
};

class Loader {
 public:
  Loader(const std::string& text, const std::string& source)
      : source_(source), joint_order_(joint_order(text, source)) {
    UrdfdomMessages messages;
    try {
      urdf_ = urdf::parseURDF(text);
    } catch (const std::exception& e) {
      messages.text += (messages.text.empty() ? "" : "; ") + std::string(e.what());
    }
    // A link whose <inertial> does not parse is kept without it; urdfdom only prints the error.
    if (!urdf_ || !messages.text.empty()) {
      refuse("not a robot description: {}; correct the URDF",
             messages.text.empty() ? "urdfdom gives no reason" : messages.text);
    }
  }

  Model load() {
    sort_joints();
    check_joints();
    walk();
    name_coordinates();
    check_well_posed();
    return std::move(model_);
  }

 private:
  template <class... Args>
  [[noreturn]] void refuse(fmt::format_string<Args...> text, Args&&... args) const {
    refuse_urdf(source_, fmt::format(text, std::forward<Args>(args)...));
  }

  static bool moves(const urdf::Joint& joint) { return joint.type != urdf::Joint::FIXED; }
  static bool independent(const urdf::Joint& joint) { return moves(joint) && !joint.mimic; }

  /// The joints below a link, in the order of the file.
  std::vector<const urdf::Joint*> joints_below(const std::string& link) const {
    const auto found = below_.find(link);
    return found == below_.end() ? std::vector<const urdf::Joint*>{} : found->second;
  }

  void sort_joints() {
    for (const auto& [name, joint] : urdf_->joints_) {
      below_[joint->parent_link_name].push_back(joint.get());
    }
    for (auto& [link, joints] : below_) {
      std::sort(joints.begin(), joints.end(), [this](const auto* a, const auto* b) {
        return joint_order_.at(a->name) < joint_order_.at(b->name);
      });
    }
  }

  /// Farther away, an inertia about a joint has no digit of the body's own left.
  void require_near(const std::string& what, const Eigen::Vector3d& offset) const {
    constexpr double farthest_m = 1e4;
    if (offset.norm() <= farthest_m) return;
    refuse("{} is {:g} m away; allowed: up to {:g} m (is it in another unit?)", what, offset.norm(),
           farthest_m);
  }

  void check_joints() {
    for (const auto& [name, joint] : urdf_->joints_) {
      const std::string where = "joint '" + name + "'";
      const urdf::Pose& X = joint->parent_to_joint_origin_transform;
      if (!vector_of(X.position).allFinite() || !rotation_of(X.rotation).allFinite()) {
        refuse("{}: origin is not finite; give finite numbers", where);
      }
      require_near(where + ": origin", vector_of(X.position));
      if (joint->type == urdf::Joint::FLOATING || joint->type == urdf::Joint::PLANAR) {
        refuse("{}: type {} is not supported; use revolute, continuous, prismatic or fixed", where,
               joint->type == urdf::Joint::PLANAR ? "planar" : "floating");
      }
      if (!moves(*joint)) {
        if (joint->mimic) {
          refuse("{}: a fixed joint cannot mimic '{}'; remove <mimic> or let it move", where,
                 joint->mimic->joint_name);
        }
        continue;
      }
      const Eigen::Vector3d axis = vector_of(joint->axis);
      if (!axis.allFinite() || axis.norm() < 1e-9) {
        refuse("{}: axis {} has no direction; give a vector of length 1", where,
               fmt::join(axis, " "));
      }
      drive_of(*joint);
      if (independent(*joint)) check_limits(*joint, where);
    }
  }

  void check_limits(const urdf::Joint& joint, const std::string& where) const {
    if (!joint.limits) {
      if (joint.type == urdf::Joint::CONTINUOUS) return;
      refuse("{}: has no <limit>; give lower, upper, effort and velocity", where);
    }
    const urdf::JointLimits& limits = *joint.limits;
    for (const auto& [what, value] :
         {std::pair{"effort", limits.effort}, std::pair{"velocity", limits.velocity}}) {
      if (!std::isfinite(value) || value < 0) {
        refuse("{}: {} limit {} is not a limit; give a finite value above 0, or 0 for none", where,
               what, value);
      }
    }
    if (joint.type == urdf::Joint::CONTINUOUS) return;
    if (!std::isfinite(limits.lower) || !std::isfinite(limits.upper) ||
        limits.lower >= limits.upper) {
      refuse("{}: limits lower {}, upper {} leave no room; give lower < upper{}", where,
             limits.lower, limits.upper,
             joint.type == urdf::Joint::REVOLUTE ? ", or type continuous" : "");
    }
  }

  /// Follows a chain of mimics to the independent joint that drives it.
  Drive drive_of(const urdf::Joint& joint) const {
    Drive drive{joint.name};
    std::set<std::string> seen;
    const urdf::Joint* at = &joint;
    while (at->mimic) {
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
      if (!moves(*next)) {
        refuse("{}: mimics joint '{}', which is fixed; mimic a joint that moves", where,
               mimic.joint_name);
      }
      drive.offset += drive.multiplier * mimic.offset;
      drive.multiplier *= mimic.multiplier;
      drive.joint = next->name;
      at = next.get();
    }
    return drive;
  }

  /// A link's mass properties in its own frame.
  MassProperties mass_of(const urdf::Link& link) const {
    if (!link.inertial) return {};
    const urdf::Inertial& in = *link.inertial;
    const Eigen::Matrix3d R = rotation_of(in.origin.rotation);
    Eigen::Matrix3d I;
    I << in.ixx, in.ixy, in.ixz, in.ixy, in.iyy, in.iyz, in.ixz, in.iyz, in.izz;
    MassProperties mass{in.mass, vector_of(in.origin.position), I};
    const std::string why = R.allFinite() ? why_not_physical(mass)
                                          : "inertial origin is not finite; give finite numbers";
    if (!why.empty()) refuse("link '{}': {}", link.name, why);
    require_near("link '" + link.name + "': inertial origin", mass.p_cm);
    // Not for R = 1, which would only round.
    if (!R.isIdentity(0)) {
      I = R * mass.I_cm * R.transpose();
      mass.I_cm = 0.5 * (I + I.transpose());
    }
    return mass;
  }

  void add_link(const std::string& name, const Frame& frame) {
    const urdf::Link& link = *urdf_->getLink(name);
    MassProperties mass = mass_of(link);
    Frame& kept = model_.frames[name] = frame;
    kept.leaf = joints_below(name).empty();
    if (frame.body < 0 || mass.mass == 0) return;
    mass.p_cm = frame.p_BF + frame.R_BF * mass.p_cm;
    if (!frame.R_BF.isIdentity(0)) {
      const Eigen::Matrix3d I = frame.R_BF * mass.I_cm * frame.R_BF.transpose();
      mass.I_cm = 0.5 * (I + I.transpose());
    }
    Body& body = model_.bodies[frame.body];
    const MassProperties both = combine({body.mass, body.p_Bcm, body.I_Bcm}, mass);
    body.mass = both.mass;
    body.p_Bcm = both.p_cm;
    body.I_Bcm = both.I_cm;
  }

  /// Depth-first; a stack of its own, since nothing bounds a chain of fixed links.
  void walk() {
    const std::string root = urdf_->getRoot()->name;
    add_link(root, Frame{});
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
      if (moves(joint)) {
        const int body = add_body(joint, frame);
        frame = Frame{};
        frame.body = body;
      }
      add_link(joint.child_link_name, frame);
      push_below(joint.child_link_name);
    }
    if (model_.num_joints == 0) {
      refuse("no joint moves; a robot needs at least one");
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
        refuse("joint '{}': more than {} joints; fix some or let them mimic others", joint.name,
               max_joints);
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
    for (Body& body : model_.bodies) {
      const urdf::Joint& joint = *urdf_->getJoint(body.joint);
      const Drive drive = drive_of(joint);
      const int j = coordinate_.at(drive.joint);
      body.coordinate = j;
      body.multiplier = drive.multiplier;
      body.offset = drive.offset;
      if (!independent(joint)) continue;
      model_.joint_names[j] = joint.name;
      model_.joint_types[j] = body.type;
      if (!joint.limits) continue;
      if (joint.type != urdf::Joint::CONTINUOUS) {
        model_.lower[j] = joint.limits->lower;
        model_.upper[j] = joint.limits->upper;
      }
      if (joint.limits->effort > 0) model_.effort_limit[j] = joint.limits->effort;
      if (joint.limits->velocity > 0) model_.velocity_limit[j] = joint.limits->velocity;
    }
  }

  /// Massless links may leave a joint without inertia: M at q = 0 and at a few other postures
  /// must be positive definite, each pivot above rounding of its diagonal entry.
  void check_well_posed() const {
    constexpr int postures = 8;
    constexpr double rounding = 1e-12;
    std::mt19937 random(1);
    Vector q = Vector::Zero(model_.num_joints);
    for (int k = 0; k < postures; ++k) {
      Matrix M = mass_matrix<double>(model_, q);
      const int failed = factorise(M, rounding);
      if (failed >= 0) {
        refuse(
            "joint '{}' moves no inertia of its own (the inertia matrix is not positive definite); "
            "give the links it moves a mass and an inertia",
            model_.joint_names[failed]);
      }
      for (double& angle : q) angle = 2.0 * random() / random.max() - 1.0;
    }
  }

  std::string source_;
  std::map<std::string, int> joint_order_;  ///< in the file
  urdf::ModelInterfaceSharedPtr urdf_;
  std::map<std::string, std::vector<const urdf::Joint*>> below_;
  std::map<std::string, int> coordinate_;
  Model model_;
};

}  // namespace

Model model_from_urdf(const std::string& text, const std::string& source) {
  return Loader(text, source).load();
}

}  // namespace tachless::robot
