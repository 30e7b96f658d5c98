#include "plant/disturbances.h"

#include <algorithm>
#include <limits>
#include <numbers>

#include "base/elementary.h"
#include "robot/kinematics.h"

namespace tachless::plant {
namespace {

constexpr double never = std::numeric_limits<double>::infinity();

}  // namespace

Disturbances::Disturbances(const std::vector<DisturbanceSpec>& specs, double period_s,
                           const robot::Model& model)
    : model_(model), period_s_(period_s) {
  for (const DisturbanceSpec& spec : specs) {
    const auto& names = model.joint_names;
    const auto joint = std::find(names.begin(), names.end(), spec.joint) - names.begin();
    sources_.push_back({&spec, spec.joint.empty() ? -1 : static_cast<int>(joint)});
  }
}

double Disturbances::next_jump(double from_s, double until_s) const {
  // Start, end and ticks are rounded decimals: times nearer than this are the same.
  const double same_s = 1e-9 * period_s_;
  double next_s = until_s;
  for (const Source& source : sources_) {
    for (const double jump_s : {source.spec->start_s, source.spec->end_s.value_or(never)}) {
      if (jump_s > from_s + same_s && jump_s < next_s - same_s) next_s = jump_s;
    }
  }
  return next_s;
}

void Disturbances::choose(double from_s, double until_s) {
  const double middle_s = from_s + (until_s - from_s) / 2;
  for (Source& source : sources_) {
    const DisturbanceSpec& spec = *source.spec;
    source.active = spec.start_s <= middle_s && middle_s < spec.end_s.value_or(never);
  }
}

void Disturbances::add(double time_s, const Vector& q, Vector& tau) const {
  using std::numbers::pi;
  for (const Source& source : sources_) {
    if (!source.active) continue;
    const DisturbanceSpec& spec = *source.spec;
    const double since_s = time_s - spec.start_s;
    double value = 1;
    switch (spec.shape) {
      case DisturbanceShape::constant:
        break;
      case DisturbanceShape::pulse:
        value = base::sin(pi * since_s / (*spec.end_s - spec.start_s));
        break;
      case DisturbanceShape::sinusoid:
        value = base::sin(2 * pi * spec.frequency_hz * since_s + spec.phase_rad);
        break;
    }
    if (source.joint >= 0) {
      tau[source.joint] += value * *spec.torque_Nm;
      continue;
    }
    const Eigen::Vector3d point(spec.point_m.data()), force(spec.force_N->data());
    tau += robot::force_torque(model_, model_.frames.at(spec.link), point, value * force, q);
  }
}

Vector Disturbances::at(double time_s, const Vector& q) {
  choose(time_s, next_jump(time_s, time_s + period_s_));
  Vector tau = Vector::Zero(model_.num_joints);
  add(time_s, q, tau);
  return tau;
}

}  // namespace tachless::plant
