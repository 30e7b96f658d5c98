#include "certificate/sampled_certificate.h"

#include <algorithm>
#include <cmath>
#include <mutex>

#include "certificate/parallel.h"
#include "certificate/postures.h"
#include "controller/registry.h"
#include "schema/schema.h"

namespace tachless::certificate {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using loop::ReferencePoint;

constexpr int reference_postures = 17;
constexpr int anywhere_postures = 96;
constexpr int motion_pieces = 240;
constexpr double shortest_s = 1e-7, longest_s = 1;

struct WorstLimit {
  std::optional<double> limit_s;
  std::size_t index = 0;
};

/// The smallest limit over postures. Searched at one posture only; at others as soon as they turn
/// out unstable below the smallest found so far.
WorstLimit worst_limit(const ScenarioLoop& scenario, const std::vector<ReferencePoint>& rests,
                       const LoopSettings& settings) {
  WorstLimit worst;
  worst.limit_s = largest_stable_period(scenario.at(rests[0], settings), {shortest_s, longest_s});
  std::mutex mutex;
  parallel_for(rests.size(), [&](std::size_t i) {
    std::optional<double> least;
    {
      const std::lock_guard lock(mutex);
      least = worst.limit_s;
    }
    if (i == 0 || !least) return;
    const SampledLoop loop = scenario.at(rests[i], settings);
    if (radius_at(loop, *least) < 1) return;
    const auto own = largest_stable_period(loop, {shortest_s, *least});
    const std::lock_guard lock(mutex);
    if (!worst.limit_s || (own && *own >= *worst.limit_s)) return;
    worst = {own, i};
  });
  return worst;
}

bool depends_on_filter(const ScenarioLoop& scenario, const ReferencePoint& at) {
  LoopSettings settings = scenario.settings();
  const auto memory_by = [&](controller::law::Discretisation filter) {
    settings.filter = filter;
    return scenario.at(at, settings).law(settings.period_s).A;
  };
  return memory_by(controller::law::Discretisation::tustin) !=
         memory_by(controller::law::Discretisation::backward_euler);
}

std::vector<ReferencePoint> anywhere(const robot::Model& model) {
  std::vector<ReferencePoint> rests;
  rests.reserve(anywhere_postures);
  rests.push_back(held_at(robot::Vector::Zero(model.num_joints)));
  for (int k = 1; k < anywhere_postures; ++k) rests.push_back(held_at(spread_posture(model, k)));
  return rests;
}

MatrixXd power(MatrixXd base, std::int64_t exponent) {
  MatrixXd result = MatrixXd::Identity(base.rows(), base.cols());
  for (; exponent > 0; exponent /= 2) {
    if (exponent % 2 == 1) result = base * result;
    base = base * base;
  }
  return result;
}

std::vector<PeriodMargin> margins_by_period(const SampledLoop& loop, double period_s,
                                            double limit_s) {
  constexpr std::size_t points = 24;
  const double low = std::min(period_s, limit_s) / 5, high = 1.3 * std::max(period_s, limit_s);
  std::vector<PeriodMargin> result(points);
  parallel_for(points, [&](std::size_t k) {
    const double h = low * std::pow(high / low, static_cast<double>(k) / (points - 1));
    result[k] = {h, margins(loop, h).modulus, radius_at(loop, h)};
  });
  return result;
}

}  // namespace

VectorXd own_gain(const LinearLaw& law) {
  const Eigen::Index n = law.D.rows();
  VectorXd gain = VectorXd::Zero(n);
  for (std::size_t i = 0; i < law.measured.size(); ++i) {
    if (law.measured[i] != Part::q && law.measured[i] != Part::theta) continue;
    const auto block = law.D.middleCols(static_cast<Eigen::Index>(i) * n, n);
    gain = gain.cwiseMax(block.diagonal().cwiseAbs());
  }
  return gain;
}

double radius_over_motion(const ScenarioLoop& loop, int pieces, std::vector<AlongPoint>* along) {
  const double h = loop.settings().period_s;
  const auto ticks = static_cast<std::int64_t>(std::llround(loop.span_s() / h));
  const auto count = std::max<std::int64_t>(1, std::min<std::int64_t>(pieces, ticks));
  const auto first_tick = [&](std::int64_t k) { return k * ticks / count; };
  std::vector<MatrixXd> maps(static_cast<std::size_t>(count));
  std::vector<AlongPoint> points(maps.size());
  parallel_for(maps.size(), [&](std::size_t i) {
    const auto k = static_cast<std::int64_t>(i);
    const std::int64_t begin = first_tick(k), length = first_tick(k + 1) - begin;
    const double t = h * (static_cast<double>(begin) + static_cast<double>(length - 1) / 2);
    const MatrixXd map = loop.map_at(t);
    points[i] = {t, along != nullptr ? spectral_radius(map) : 0};
    maps[i] = power(map, length);
  });
  if (along != nullptr) *along = points;
  const double over_pieces = radius_along([&](int k) { return maps[static_cast<std::size_t>(k)]; },
                                          static_cast<int>(count));
  return std::pow(over_pieces, static_cast<double>(count) /
                                   static_cast<double>(std::max<std::int64_t>(ticks, 1)));
}

std::optional<SampledCertificate> sampled_certificate(const experiment::Scenario& scenario,
                                                      const OnProgress& on_progress) {
  const auto tell = [&](std::string_view what) {
    if (on_progress) on_progress(what);
  };
  if (!controller::law_facts(scenario.controller.law).no_linearisation.empty()) return {};
  const ScenarioLoop loop(scenario);
  SampledCertificate result;
  result.settings = loop.settings();
  const double h = result.settings.period_s;
  const std::vector<ReferencePoint> rests = loop.rests(reference_postures);

  tell("sampled loop: limits");
  const LinearLaw law = loop.at(rests[0]).law(h);
  result.has_filter = depends_on_filter(loop, rests[0]);
  const WorstLimit worst = worst_limit(loop, rests, result.settings);
  result.limit_s = worst.limit_s;
  result.limit_q = rests[worst.index].q_ref;
  for (const auto& kind : schema::names<controller::law::Discretisation>) {
    if (!result.has_filter && kind.value != result.settings.filter) continue;
    FilterLimits limits{kind.value, {}, {}};
    limits.delay_0_s = worst_limit(loop, rests, {kind.value, 0, h}).limit_s;
    limits.delay_1_s = worst_limit(loop, rests, {kind.value, 1, h}).limit_s;
    result.limits.push_back(limits);
  }

  tell("sampled loop: other postures");
  const std::vector<ReferencePoint> others = anywhere(*scenario.model);
  const WorstLimit other = worst_limit(loop, others, result.settings);
  result.anywhere_limit_s = other.limit_s;
  result.anywhere_q = others[other.index].q_ref;
  result.anywhere_postures = anywhere_postures;

  tell("sampled loop: modes and margins");
  std::vector<Modes> all(rests.size());
  parallel_for(rests.size(), [&](std::size_t i) { all[i] = modes(loop.at(rests[i]), h); });
  result.modes = *std::max_element(
      all.begin(), all.end(), [](const Modes& a, const Modes& b) { return a.radius < b.radius; });
  const SampledLoop binding = loop.at(rests[worst.index]);
  result.margins = margins(binding, h);
  result.by_period = margins_by_period(binding, h, result.limit_s.value_or(h));

  tell("sampled loop: along the reference");
  result.radius_along =
      loop.moves() ? radius_over_motion(loop, motion_pieces, &result.along) : result.modes.radius;
  result.stable = result.modes.stable && result.radius_along < 1;

  result.gain_Nm_per_rad = own_gain(law);
  if (scenario.plant.encoder.resolution_bits) {
    result.count_Nm = result.gain_Nm_per_rad.cwiseProduct(
        VectorXd(experiment::encoder_count(scenario, *scenario.model)));
  }
  return result;
}

}  // namespace tachless::certificate
