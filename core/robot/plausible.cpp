#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "robot/urdf_xml.h"

namespace tachless::robot {
namespace {

constexpr double largest_angle = 4 * std::numbers::pi;  ///< [rad]; two turns
constexpr double longest_link_m = 10, heaviest_link_kg = 1000;

class Judge {
 public:
  Judge(const UrdfTree& tree, const std::string& source) : tree_(tree), source_(source) {
    for (const auto& [name, joint] : tree.joints) {
      longest_ = std::max(longest_, joint.p.norm());
      size_[joint.parent] = std::max(size_[joint.parent], joint.p.norm());
      size_[joint.child] = std::max(size_[joint.child], joint.p.norm());
    }
  }

  std::vector<std::string> lines() {
    for (const std::string& name : tree_.order) {
      const UrdfJoint& joint = tree_.joints.at(name);
      judge(joint);
      judge(joint.child, tree_.links.at(joint.child));
    }
    return std::move(lines_);
  }

 private:
  template <class... Args>
  void add(fmt::format_string<Args...> text, Args&&... args) {
    lines_.push_back(source_ + ": " + fmt::format(text, std::forward<Args>(args)...));
  }

  void judge(const UrdfJoint& joint) {
    const std::string where = "joint '" + joint.name + "'";
    if (joint.p.norm() > longest_link_m) {
      add("{}: its origin is {:g} m away; is it in millimetres?", where, joint.p.norm());
    }
    if (joint.largest_angle > largest_angle) {
      add("{}: its origin has an angle of {:g} rad; is it in degrees?", where, joint.largest_angle);
    }
    if (joint.fixed || joint.mimic) return;
    if (joint.zero_effort) {
      add("{}: effort 0: it is driven without limit here; Drake, Gazebo and ros2_control take it "
          "for not driven",
          where);
    }
    if (joint.zero_velocity) add("{}: velocity 0: it has no velocity limit here", where);
    const double range = std::max(std::abs(joint.lower), std::abs(joint.upper));
    if (joint.has_range && joint.type == JointType::revolute && range > largest_angle) {
      add("{}: its range is {:g} to {:g} rad; is it in degrees?", where, joint.lower, joint.upper);
    }
    if (joint.has_range && joint.type == JointType::prismatic && range > longest_link_m) {
      add("{}: its range is {:g} to {:g} m; is it in millimetres?", where, joint.lower,
          joint.upper);
    }
  }

  void judge(const std::string& name, const UrdfLink& link) {
    const std::string where = "link '" + name + "'";
    const MassProperties& body = link.mass;
    if (link.largest_angle > largest_angle) {
      add("{}: its inertial has an angle of {:g} rad; is it in degrees?", where,
          link.largest_angle);
    }
    if (body.mass > heaviest_link_kg) {
      add("{}: it has {:g} kg; is it in grams?", where, body.mass);
    }
    if (!(body.mass > 0)) return;
    const double far = body.p_Bcm.norm();
    if (longest_ > 0 && far > 3 * std::max(longest_, 0.1)) {
      add("{}: its centre of mass is {:g} m away; the longest link of the robot has {:g} m", where,
          far, longest_);
    }
    if (body.I_Bcm.isZero(0)) {
      add("{}: {:g} kg without inertia: a point mass", where, body.mass);
      return;
    }
    const double gyration = std::sqrt(body.I_Bcm.diagonal().maxCoeff() / body.mass);
    const double size = std::max({size_[name], far, 0.2 * longest_});
    if (size > 0 && gyration > 2 * size) {
      add("{}: its radius of gyration is {:g} m; the link is {:g} m long", where, gyration, size);
    } else if (gyration < 1e-4 * longest_) {
      add("{}: its radius of gyration is {:g} m; the longest link of the robot has {:g} m", where,
          gyration, longest_);
    }
  }

  const UrdfTree& tree_;
  const std::string& source_;
  double longest_ = 0;                  ///< distance of two joints [m]
  std::map<std::string, double> size_;  ///< of a link, from its joints [m]
  std::vector<std::string> lines_;
};

}  // namespace

std::vector<std::string> improbable_numbers(const std::string& text, const std::string& source,
                                            const std::map<std::string, double>& locked) {
  const UrdfTree tree = read_urdf_xml(text, source, locked);
  return Judge(tree, source).lines();
}

}  // namespace tachless::robot
