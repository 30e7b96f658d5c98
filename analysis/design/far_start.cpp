#include "design/far_start.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>

#include "base/failure.h"
#include "in_process/in_process_loop.h"

namespace tachless::design {
namespace {

// An arm that is back needs no longer: its errors settle within a second. A scenario may be longer.
constexpr double longest_s = 5;
// Share of the first error. Dry friction leaves some of an error; a tumbling arm makes it larger.
constexpr double back = 0.05;

/// Returns the posture, moved by the start's error towards the middle of each joint's range. An
/// empty posture is zero.
Vector moved_beside(const robot::Model& model, Vector q) {
  if (q.size() == 0) q = Vector::Zero(model.num_joints);
  for (int i = 0; i < model.num_joints; ++i) {
    const double low = model.lower[i], high = model.upper[i];
    const bool bounded = low > -robot::Model::unlimited && high < robot::Model::unlimited;
    const double by = bounded ? std::min(far_start_error, (high - low) / 4) : far_start_error;
    q[i] += bounded && q[i] > (low + high) / 2 ? -by : by;
  }
  return q;
}

}  // namespace

bool returns_from_beside(const scenario::Scenario& scenario, const Design& design) {
  scenario::Scenario run = scenario;
  run.controller.gains = design.gains;
  run.plant.mechanics = plant::Mechanics::native;
  // Speed and position are not limited here: a start beside the motion exceeds speed limits for a
  // moment. Exact encoders need no range.
  robot::Model unbounded = *scenario.model;
  unbounded.lower.setConstant(-robot::Model::unlimited);
  unbounded.upper.setConstant(robot::Model::unlimited);
  unbounded.velocity_limit.setConstant(robot::Model::unlimited);
  run.model = std::make_shared<const robot::Model>(std::move(unbounded));
  run.plant.encoder = {};
  run.plant.speed_limit_rad_per_s = {};
  const double h = run.loop.period_s;
  run.loop.num_ticks = std::min<std::int64_t>(run.loop.num_ticks, std::llround(longest_s / h));
  run.loop.duration_s = static_cast<double>(run.loop.num_ticks) * h;
  double first = 0, late = 0;
  try {
    run.plant.initial.position_rad = moved_beside(*scenario.model, run.plant.initial.position_rad);
    in_process::run_in_process(run, [&](const in_process::TickRecord& record) {
      const double error = (record.truth.q - record.reference.q_ref).cwiseAbs().maxCoeff();
      if (record.tick == 0) first = error;
      if (2 * record.tick >= run.loop.num_ticks) late = std::max(late, error);
      return late <= back * first;
    });
  } catch (const base::Failure& failure) {
    if (failure.code() != base::ExitCode::protective_stop) throw;
    return false;
  }
  return late <= back * first;
}

}  // namespace tachless::design
