#include "identify/separation.h"

#include <algorithm>

#include "robot/kinematics.h"

namespace tachless::identify {
namespace {

/// Returns whether a joint connects two bodies, or they are one.
bool are_neighbours(const robot::Model& model, int a, int b) {
  const auto parent = [&](int body) {
    return body < 0 ? -2 : model.bodies[static_cast<std::size_t>(body)].parent;
  };
  return a == b || parent(a) == b || parent(b) == a;
}

}  // namespace

Separation::Separation(const scenario::Scenario& scenario, const std::string& urdf)
    : model_(*scenario.model), capsules_(robot::link_capsules(urdf)) {
  const std::vector<robot::Capsule> at = placed(scenario.plant.initial.position_rad);
  const auto add_meeting = [&](const Pair& pair) {
    const auto same = [&](const Pair& other) { return other.a == pair.a && other.b == pair.b; };
    const auto known = std::ranges::find_if(meeting_, same);
    if (known == meeting_.end()) return meeting_.push_back(pair);
    known->distance = std::min(known->distance, pair.distance);
  };
  for (std::size_t i = 0; i < at.size(); ++i) {
    for (std::size_t k = i + 1; k < at.size(); ++k) {
      if (are_neighbours(model_, model_.frames.at(at[i].link).body,
                         model_.frames.at(at[k].link).body)) {
        continue;
      }
      const double distance = robot::distance(at[i], at[k]);
      if (distance <= 0) {
        add_meeting({at[i].link, at[k].link, distance});
      } else {
        compared_.emplace_back(i, k);
      }
    }
  }
  std::erase_if(compared_, [&](const auto& pair) {
    return std::ranges::any_of(meeting_, [&](const Pair& each) {
      return each.a == at[pair.first].link && each.b == at[pair.second].link;
    });
  });
}

std::vector<robot::Capsule> Separation::placed(const Vector& q) const {
  std::vector<robot::Capsule> result = capsules_;
  const std::string* link = nullptr;
  robot::Pose<double> pose;
  for (robot::Capsule& each : result) {
    if (link == nullptr || *link != each.link) {
      link = &each.link;
      pose = robot::frame_pose(model_, model_.frames.at(each.link), q);
    }
    each.from = pose.R * each.from + pose.p;
    each.to = pose.R * each.to + pose.p;
  }
  return result;
}

std::optional<Separation::Pair> Separation::nearest(const Vector& q) const {
  if (compared_.empty()) return {};
  const std::vector<robot::Capsule> at = placed(q);
  std::optional<Pair> result;
  for (const auto& [i, k] : compared_) {
    const double distance = robot::distance(at[i], at[k]);
    if (!result || distance < result->distance) result = {at[i].link, at[k].link, distance};
  }
  return result;
}

}  // namespace tachless::identify
