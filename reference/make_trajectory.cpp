#include "reference/make_trajectory.h"
#include "diagnostics/text.h"
#include "robot/model.h"

#include <fmt/format.h>

namespace tachless::reference {

Trajectory make_trajectory(const experiment::Scenario& scenario) {
  const auto* const file = std::get_if<trajectory::MotionFile>(&scenario.reference);
  if (file != nullptr && file->motion == nullptr) {
    throw scenario.complaint("reference.file",
                             file->path + " is named here, and not in the log or message");
  }
  Trajectory made(scenario.reference);
  const robot::Model& model = *scenario.model;
  const robot::JointLabels joints = robot::joint_labels(model);
  const int last = last_instant(scenario.loop.duration_s);
  for (int k = 0; k <= last; ++k) {
    const double t_s = scenario.loop.duration_s * k / last;
    const robot::Vector q_ref = made.at(t_s).q_ref;
    for (Eigen::Index i = 0; i < q_ref.size(); ++i) {
      if (model.lower[i] <= q_ref[i] && q_ref[i] <= model.upper[i]) continue;
      const std::string_view name =
          std::visit([](const auto& spec) { return spec.name; }, scenario.reference);
      throw scenario.complaint(
          fmt::format("reference.{}", name),
          fmt::format("{} is at {} {} at t = {:g} s; allowed by the URDF: {:g} to {:g}",
                      joints.joint(static_cast<std::size_t>(i)), diagnostics::shortest(q_ref[i]),
                      joints.length[static_cast<std::size_t>(i)], t_s, model.lower[i],
                      model.upper[i]));
    }
  }
  return made;
}

}  // namespace tachless::reference
