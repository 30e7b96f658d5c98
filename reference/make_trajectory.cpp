#include "reference/make_trajectory.h"

#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>

#include "robot/model.h"

namespace tachless::reference {
namespace {

void require_one_per_joint(const experiment::Scenario& scenario, const std::string& key,
                           const robot::Vector& value) {
  if (value.size() != scenario.num_joints) {
    std::ostringstream problem;
    problem << value.size() << " entries; needed: one per joint, " << scenario.num_joints;
    throw scenario.complaint(key, problem.str());
  }
}

/// Builds each kind; `key` is where it stands in the scenario.
struct Maker {
  const experiment::Scenario& scenario;
  std::string key;

  Trajectory::Shape operator()(const experiment::Hold& spec) const {
    require_one_per_joint(scenario, key + ".position_rad", spec.position_rad);
    return trajectory::Hold{spec.position_rad};
  }

  Trajectory::Shape operator()(const experiment::Sinusoid& spec) const {
    require_one_per_joint(scenario, key + ".offset_rad", spec.offset_rad);
    return trajectory::MultiSine{spec.offset_rad, {sine(key, spec)}};
  }

  Trajectory::Shape operator()(const experiment::MultiSine& spec) const {
    require_one_per_joint(scenario, key + ".offset_rad", spec.offset_rad);
    trajectory::MultiSine made{spec.offset_rad, {}};
    for (std::size_t i = 0; i < spec.terms.size(); ++i) {
      made.terms.push_back(sine(key + ".terms[" + std::to_string(i) + "]", spec.terms[i]));
      if (spec.terms[i].offset_rad.size() == made.offset.size()) {
        made.offset += spec.terms[i].offset_rad;
      }
    }
    return made;
  }

  Trajectory::Shape operator()(const experiment::PointToPoint& spec) const {
    require_one_per_joint(scenario, key + ".from_rad", spec.from_rad);
    require_one_per_joint(scenario, key + ".to_rad", spec.to_rad);
    if (!(spec.duration_s > 0)) {
      std::ostringstream problem;
      problem << spec.duration_s << "; allowed: greater than 0";
      throw scenario.complaint(key + ".duration_s", problem.str());
    }
    return trajectory::PointToPoint{spec.from_rad, spec.to_rad, spec.start_s, spec.duration_s};
  }

  Trajectory::Shape operator()(const experiment::Waypoints& spec) const {
    for (const robot::Vector& position : spec.position_rad) {
      require_one_per_joint(scenario, key + ".position_rad", position);
    }
    try {
      return trajectory::Waypoints(spec.time_s, spec.position_rad);
    } catch (const std::invalid_argument& problem) {
      throw scenario.complaint(key + ".time_s", problem.what());
    }
  }

  [[nodiscard]] trajectory::Sine sine(const std::string& at,
                                      const experiment::Sinusoid& spec) const {
    require_one_per_joint(scenario, at + ".amplitude_rad", spec.amplitude_rad);
    require_one_per_joint(scenario, at + ".frequency_hz", spec.frequency_hz);
    require_one_per_joint(scenario, at + ".phase_rad", spec.phase_rad);
    return {spec.amplitude_rad, spec.frequency_hz, spec.phase_rad};
  }
};

std::string key_of(const experiment::ReferenceSpec& spec) {
  struct Name {
    std::string operator()(const experiment::Hold&) const { return "reference.hold"; }
    std::string operator()(const experiment::Sinusoid&) const { return "reference.sinusoid"; }
    std::string operator()(const experiment::MultiSine&) const { return "reference.multi_sine"; }
    std::string operator()(const experiment::PointToPoint&) const {
      return "reference.point_to_point";
    }
    std::string operator()(const experiment::Waypoints&) const { return "reference.waypoints"; }
  };
  return std::visit(Name{}, spec);
}

/// A closed form need not be searched for its extremes: a limit that is passed between two of
/// these instants is passed by next to nothing.
constexpr int num_instants = 2000;

void require_within_limits(const experiment::Scenario& scenario, const std::string& key,
                           const Trajectory& trajectory) {
  const robot::Model model =
      robot::model_from_urdf(scenario.robot.urdf_text, scenario.robot.urdf_path);
  for (int k = 0; k <= num_instants; ++k) {
    const double t_s = scenario.loop.duration_s * k / num_instants;
    const robot::Vector q_ref = trajectory.at(t_s).q_ref;
    for (Eigen::Index i = 0; i < q_ref.size(); ++i) {
      if (!(model.lower[i] <= q_ref[i] && q_ref[i] <= model.upper[i])) {
        std::ostringstream problem;
        problem << "joint " << i + 1 << " (" << model.joint_names[i] << ") is at " << q_ref[i]
                << " rad at t = " << t_s << " s; allowed by the URDF: " << model.lower[i] << " to "
                << model.upper[i];
        throw scenario.complaint(key, problem.str());
      }
    }
  }
}

}  // namespace

Trajectory make_trajectory(const experiment::Scenario& scenario) {
  const std::string key = key_of(scenario.reference);
  Trajectory made(std::visit(Maker{scenario, key}, scenario.reference));
  require_within_limits(scenario, key, made);
  return made;
}

}  // namespace tachless::reference
