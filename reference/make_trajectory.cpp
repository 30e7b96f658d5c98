#include "reference/make_trajectory.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/text.h"
#include "robot/model.h"

namespace tachless::reference {
namespace {

constexpr int per_cycle = 50, per_piece = 4;

/// Returns the highest frequency of which both are multiples, with a relative tolerance of 1e-9.
double common_frequency(double a, double b) {
  const double least = 1e-9 * std::max(a, b);
  while (b > least) a = std::exchange(b, std::fmod(a, b));
  return a;
}

}  // namespace

Motion::Motion(const scenario::Scenario& scenario, const Trajectory& trajectory) {
  const double run_s = scenario.loop.duration_s;
  double fastest_hz = 0, common_hz = 0;
  const trajectory::Composition parts = composition_of(scenario.reference);
  for (const trajectory::Sine& sine : parts.sines) {
    for (Eigen::Index i = 0; i < sine.amplitude_rad.size(); ++i) {
      if (sine.amplitude_rad[i] == 0 || sine.frequency_hz[i] == 0) continue;
      fastest_hz = std::max(fastest_hz, sine.frequency_hz[i]);
      common_hz = common_frequency(common_hz, sine.frequency_hz[i]);
    }
  }
  time_s_ = parts.piece_times_s;
  if (common_hz > 0) time_s_ = {0, 1 / common_hz};
  const bool in_run = std::erase_if(time_s_, [&](double t_s) { return t_s >= run_s; }) == 0;
  if (time_s_.empty()) return;
  if (!in_run) time_s_.push_back(run_s);

  begin_s = time_s_.front();
  end_s = time_s_.back();
  const double least_s = (end_s - begin_s) / (4 * static_cast<double>(time_s_.size() - 1));
  share_ = {0};
  for (std::size_t k = 1; k < time_s_.size(); ++k) {
    share_.push_back(share_.back() + std::max(time_s_[k] - time_s_[k - 1], least_s));
  }
  for (const double total = share_.back(); double& share : share_) share /= total;
  cycles_ = fastest_hz * (end_s - begin_s);
  repeats = common_hz > 0 && in_run;
  const auto at_rest = [&](double t_s) { return trajectory.at(t_s).v_ref.isZero(0); };
  if (std::ranges::all_of(closely(), at_rest)) end_s = begin_s;
}

double Motion::at(double share) const {
  if (!moves()) return begin_s;
  const auto k = static_cast<std::size_t>(
      std::upper_bound(share_.begin() + 1, share_.end() - 1, share) - share_.begin());
  const double part = (share - share_[k - 1]) / (share_[k] - share_[k - 1]);
  return time_s_[k - 1] + part * (time_s_[k] - time_s_[k - 1]);
}

std::vector<double> Motion::instants(int count) const {
  if (!moves() || count < 2) return {begin_s};
  const bool irregular = cycles_ > 1.5 && count < per_cycle * cycles_;
  std::vector<double> result;
  for (int k = 0; k < count; ++k) {
    // The fractional parts of the golden ratio's multiples are spread evenly over [0, 1) for any
    // number of samples.
    const double beyond = irregular && k + 1 < count ? std::fmod(k * 0.6180339887498949, 1) : 0;
    result.push_back(at((k + beyond) / (count - 1)));
  }
  return result;
}

std::vector<double> Motion::closely(int at_least, int at_most) const {
  const double pieces = static_cast<double>(time_s_.size());
  const double wanted = 1 + std::max(per_cycle * cycles_, per_piece * pieces);
  return instants(std::max(at_least, static_cast<int>(std::min<double>(wanted, at_most))));
}

Trajectory make_trajectory(const scenario::Scenario& scenario) {
  const auto* const file = std::get_if<trajectory::MotionFile>(&scenario.reference);
  if (file != nullptr && file->motion == nullptr) {
    throw scenario.complaint("reference.file",
                             file->path +
                                 " is a table, which a log or message does not hold; give the "
                                 "scenario's file");
  }
  Trajectory made(scenario.reference);
  const robot::Model& model = *scenario.model;
  const robot::JointLabels joints = robot::joint_labels(model);
  for (const double t_s : Motion(scenario, made).closely()) {
    const Vector q_ref = made.at(t_s).q_ref;
    for (Eigen::Index i = 0; i < q_ref.size(); ++i) {
      if (model.lower[i] <= q_ref[i] && q_ref[i] <= model.upper[i]) continue;
      const std::string_view name =
          std::visit([](const auto& spec) { return spec.name; }, scenario.reference);
      throw scenario.complaint(
          fmt::format("reference.{}", name),
          fmt::format("{} is at {} {} at t = {:g} s; allowed by the URDF: {:g} to {:g}",
                      joints.joint(static_cast<std::size_t>(i)), base::shortest(q_ref[i]),
                      joints.length[static_cast<std::size_t>(i)], t_s, model.lower[i],
                      model.upper[i]));
    }
  }
  return made;
}

}  // namespace tachless::reference
