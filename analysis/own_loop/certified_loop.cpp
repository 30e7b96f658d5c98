#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/failure.h"
#include "base/parallel.h"
#include "base/text.h"
#include "certify/prediction.h"
#include "linear/scenario_loop.h"
#include "numerics/postures.h"
#include "own_loop/loop_impl.h"
#include "own_loop/own_loop.h"

namespace tachless::own_loop {
namespace {

using certify::Prediction;
namespace trajectory = reference::trajectory;

constexpr int box_postures =
    128;  ///< of the bounds, from the worst of which a worse one is searched
constexpr int posture_searches = 200;  ///< evaluations of that search

Prediction analyse(scenario::Scenario scenario, reference::Spec reference, double duration_s = 1) {
  scenario.reference = std::move(reference);
  scenario.loop.duration_s = duration_s;
  return certify::analyse(scenario, linear::Effort::quick);
}

/// Returns the posture of the box at which the loop at rest is the least stable, searched.
Vector worst_posture(const scenario::Scenario& scenario, const Bounds& bounds) {
  robot::Model box = *scenario.model;  // postures are spread over the range of sliding joints
  box.lower = bounds.lower;
  box.upper = bounds.upper;
  std::ranges::fill(box.joint_types, robot::JointType::prismatic);
  const linear::ScenarioLoop loop(scenario);
  const double h = scenario.loop.period_s;
  const auto radius = [&](const Vector& q) {
    return linear::radius_at(loop.at(linear::constant_reference(q)), h);
  };
  const std::vector<double> all = base::parallel_map(std::size_t{box_postures}, [&](std::size_t k) {
    return radius(numerics::spread_posture(box, static_cast<int>(k)));
  });
  const auto first = static_cast<int>(std::ranges::max_element(all) - all.begin());
  const auto inside = [&](const Eigen::VectorXd& q) {
    return (q.array() >= bounds.lower.array()).all() && (q.array() <= bounds.upper.array()).all();
  };
  constexpr double step = 0.1;  // [rad; m]
  const numerics::Minimum worst = numerics::minimise(
      [&](const Eigen::VectorXd& q) { return inside(q) ? -radius(q) : infinity; },
      numerics::spread_posture(box, first), step, posture_searches);
  return worst.x;
}

/// Returns a motion about `middle` as fast as the bounds allow. Its joints have different
/// frequencies, so that it passes through the whole box.
/// @param share of the way from the middle to the nearer end of the box
trajectory::Sinusoid motion_within(const Bounds& bounds, const Vector& middle, bool largest) {
  const Eigen::Index n = middle.size();
  trajectory::Sinusoid motion;
  motion.offset_rad = middle;
  motion.amplitude_rad = motion.frequency_hz = motion.phase_rad = Vector::Zero(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double v = bounds.speed[i], a = bounds.acceleration[i];
    const double reach =
        (1 - 1e-9) * std::min(bounds.upper[i] - middle[i], middle[i] - bounds.lower[i]);
    if (!(reach > 0)) continue;
    // Speed and acceleration reach their bounds together at the amplitude v^2 / a.
    const double amplitude = largest ? reach : std::min(reach, v * v / a);
    const double w = std::min(v / amplitude, std::sqrt(a / amplitude));
    const double turn = std::fmod(static_cast<double>(i) * std::numbers::phi, 1);
    motion.amplitude_rad[i] = amplitude;
    motion.frequency_hz[i] = (largest ? 1 - 0.25 * turn : 1) * w / (2 * std::numbers::pi);
    motion.phase_rad[i] = 2 * std::numbers::pi * turn;
  }
  return motion;
}

/// Returns the duration of four cycles of the slowest joint.
double duration_of(const trajectory::Sinusoid& motion) {
  double slowest_hz = infinity;
  for (const double hz : motion.frequency_hz) {
    if (hz > 0) slowest_hz = std::min(slowest_hz, hz);
  }
  return std::isfinite(slowest_hz) ? 4 / slowest_hz : 1;
}

/// @param what is certified: "at rest"
void require_stable(const Prediction& loop, const std::string& source, std::string_view what,
                    std::string_view remedy) {
  if (!loop.unknown.empty()) {
    throw NotCertified(
        fmt::format("{}: no certificate: the law cannot be linearised ({}); take "
                    "another law, or a Loop, which is not certified",
                    source, loop.unknown));
  }
  if (loop.stable) return;
  std::vector<std::string> remedies;
  if (const std::optional<double> period_s = stable_period(loop)) {
    remedies.push_back(fmt::format("take a period of {:g} s", *period_s));
  }
  if (!remedy.empty()) remedies.emplace_back(remedy);
  remedies.emplace_back("choose softer gains");
  throw NotCertified(fmt::format("{}: no certificate{}: {}; {}", source, what, certify::text(loop),
                                 base::joined(remedies, " or ")));
}

void add(Certificate& all, const Prediction& loop) {
  const auto n = static_cast<std::size_t>(loop.stiffness.size());
  const double limit_s = loop.limit_s.value_or(0);
  const bool first = all.stiffness.empty();
  all.limit_s = first ? limit_s : std::min(all.limit_s, limit_s);
  all.settling_s = std::max(all.settling_s, loop.modes.settling_s);
  if (first) all.stiffness.assign(n, infinity);
  for (std::size_t i = 0; i < n; ++i) {
    all.stiffness[i] = std::min(all.stiffness[i], loop.stiffness[static_cast<Eigen::Index>(i)]);
  }
}

/// Certifies references of the caller's: at rest at the worst posture of the box, along a motion
/// through the whole box, and along the motion with the largest speed and acceleration at once.
void certify_bounds(Certificate& all, const scenario::Scenario& scenario, const Bounds& bounds) {
  const std::string& source = scenario.source;
  const Vector middle = 0.5 * (bounds.lower + bounds.upper);
  require_stable(analyse(scenario, trajectory::Hold{middle}), source, " within the bounds", "");
  const Vector worst = worst_posture(scenario, bounds);
  const Prediction rest = analyse(scenario, trajectory::Hold{worst});
  require_stable(rest, source,
                 fmt::format(" within the bounds, at q = {}",
                             certify::list_text(certify::found_posture(worst))),
                 "");
  add(all, rest);
  for (const bool largest : {true, false}) {
    const trajectory::Sinusoid motion =
        motion_within(bounds, largest ? middle : Vector(0.5 * (middle + worst)), largest);
    const Prediction moving = analyse(scenario, motion, duration_of(motion));
    require_stable(moving, source, " of motions as fast as the bounds",
                   "declare a smaller speed and acceleration");
    add(all, moving);
  }
  all.text += fmt::format(
      "{}{}; at the worst posture found of the bounds' box, q = {}, and along motions as fast as "
      "the "
      "bounds",
      all.text.empty() ? "" : "; ", certify::text(rest),
      certify::list_text(certify::found_posture(worst)));
}

}  // namespace

CertifiedLoop::CertifiedLoop(const std::string& scenario_file, const std::vector<std::string>& set)
    : Loop(scenario_file, set) {
  certify(nullptr);
}

CertifiedLoop::CertifiedLoop(const std::string& scenario_file, const ReferenceBounds& bounds,
                             const std::vector<std::string>& set)
    : Loop(scenario_file, set) {
  certify(&bounds);
}

CertifiedLoop::CertifiedLoop(const LawSettings& law, const ReferenceBounds& bounds,
                             const std::vector<std::string>& set)
    : Loop(law, set) {
  certify(&bounds);
}

void CertifiedLoop::certify(const ReferenceBounds* bounds) {
  const scenario::Scenario& scenario = impl_->scenario;
  impl_->needs_bounds = true;
  if (bounds == nullptr && !impl_->has_reference) {
    throw scenario.complaint("reference",
                             "missing; a certificate needs one, or the bounds of your references");
  }
  if (impl_->has_reference) {
    const Prediction loop = certify::analyse(scenario, linear::Effort::quick);
    require_stable(loop, scenario.source, "", "");
    add(certificate_, loop);
    certificate_.text = certify::text(loop);
  }
  if (bounds == nullptr) return;
  impl_->bounds.emplace(*bounds, *scenario.model);
  certify_bounds(certificate_, scenario, *impl_->bounds);
}

}  // namespace tachless::own_loop
