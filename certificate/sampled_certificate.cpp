#include "certificate/sampled_certificate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
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
constexpr double verdict_ratio = 1.3, verdict_precision = 2e-3, verdict_longest_s = 0.5;

struct WorstLimit {
  std::optional<double> limit_s;
  std::size_t index = 0;
};

/// The smallest limit over postures. Searched at one posture only; at others as soon as they turn
/// out unstable below the smallest found so far.
WorstLimit worst_limit(const ScenarioLoop& scenario, const std::vector<ReferencePoint>& rests,
                       const controller::law::Settings& settings) {
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
  controller::law::Settings settings = scenario.settings();
  const auto memory_by = [&](controller::law::Discretisation filter) {
    settings.filter = filter;
    return scenario.at(at, settings).law(settings.period_s).A;
  };
  return memory_by(controller::law::Discretisation::tustin) !=
         memory_by(controller::law::Discretisation::backward_euler);
}

std::vector<ReferencePoint> anywhere(const robot::Model& model) {
  std::vector<ReferencePoint> rests = {held_at(robot::Vector::Zero(model.num_joints))};
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
  return parallel_map(points, [&](std::size_t k) {
    const double h = low * std::pow(high / low, static_cast<double>(k) / (points - 1));
    return PeriodMargin{h, margins(loop, h).modulus, radius_at(loop, h)};
  });
}

/// Per period over the motion, in `pieces` each of which stands for equally many periods.
double radius_over_motion(const ScenarioLoop& loop, int pieces,
                          std::vector<AlongPoint>* along = nullptr) {
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

/// The largest stable period at or around `period_s`, which `stable` says of itself.
std::optional<double> limit_near(const SampledLoop& loop, double period_s, bool stable) {
  double from = period_s;
  for (; !stable && from > shortest_s; stable = radius_at(loop, from) < 1) from /= verdict_ratio;
  if (!stable) return {};
  return largest_stable_period(
      loop, {from, std::max(verdict_longest_s, from), verdict_ratio, verdict_precision});
}

/// A round period below the limit: one or two digits.
double round_below(double limit_s) {
  const double wanted = 0.8 * limit_s;
  const double decade = std::pow(10, std::floor(std::log10(wanted)));
  for (const double digit : {5.0, 2.0, 1.0}) {
    if (digit * decade <= wanted) return digit * decade;
  }
  return decade;
}

std::string rate_text(double period_s) {
  const double hz = 1 / period_s;
  return hz >= 1000 ? fmt::format("{:.4g} kHz", hz / 1000) : fmt::format("{:.4g} Hz", hz);
}

}  // namespace

std::string period_text(double seconds) {
  if (seconds >= 1) return fmt::format("{:.4g} s", seconds);
  if (seconds >= 1e-3) return fmt::format("{:.4g} ms", 1e3 * seconds);
  return fmt::format("{:.4g} µs", 1e6 * seconds);
}

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

std::optional<SampledCertificate> sampled_certificate(const experiment::Scenario& scenario,
                                                      const OnProgress& tell) {
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
  for (const auto kind : schema::values_of<controller::law::Discretisation>()) {
    if (!result.has_filter && kind != result.settings.filter) continue;
    const auto limit = [&](int delay) {
      controller::law::Settings settings = result.settings;
      settings.filter = kind;
      settings.command_delay = delay;
      return worst_limit(loop, rests, settings).limit_s;
    };
    result.limits.push_back({kind, limit(0), limit(1)});
  }

  tell("sampled loop: other postures");
  const std::vector<ReferencePoint> others = anywhere(*scenario.model);
  const WorstLimit other = worst_limit(loop, others, result.settings);
  result.anywhere_limit_s = other.limit_s;
  result.anywhere_q = others[other.index].q_ref;
  result.anywhere_postures = anywhere_postures;

  tell("sampled loop: modes and margins");
  const std::vector<Modes> all =
      parallel_map(rests.size(), [&](std::size_t i) { return modes(loop.at(rests[i]), h); });
  result.modes = *std::ranges::max_element(all, {}, &Modes::radius);
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

Verdict verdict(const experiment::Scenario& scenario) {
  Verdict result;
  const controller::law::Settings settings = controller::law_settings(scenario);
  result.period_s = settings.period_s;
  result.delay = settings.command_delay;
  result.unknown = controller::law_facts(scenario.controller.law).no_linearisation;
  if (!result.unknown.empty()) return result;
  const ScenarioLoop loop(scenario);
  const double h = result.period_s;

  constexpr int postures = 5, pieces = 12;
  const std::vector<ReferencePoint> rests = loop.rests(postures);
  double radius = 0;
  std::size_t worst = 0;
  for (std::size_t i = 0; i < rests.size(); ++i) {
    const double here = radius_at(loop.at(rests[i]), h);
    if (here > radius) worst = i;
    radius = std::max(radius, here);
  }
  const double over_motion = loop.moves() ? radius_over_motion(loop, pieces) : radius;
  // A posture that is unstable counts only where the motion as a whole does not decay, or stays.
  const double at_the_end = radius_at(loop.at(rests.back()), h);
  const bool periodic = loop.span_s() < scenario.loop.duration_s;
  const double deciding = periodic ? over_motion : std::max(over_motion, at_the_end);
  result.stable = deciding < 1;

  const SampledLoop binding = loop.at(rests[worst]);
  result.limit_s = limit_near(binding, h, radius < 1);
  for (const auto& rest : rests) {  // the slowest posture need not be the one with the least limit
    if (!result.limit_s) break;
    const SampledLoop other = loop.at(rest);
    if (radius_at(other, *result.limit_s) >= 1.0 + verdict_precision) {
      result.limit_s = limit_near(other, *result.limit_s, false);
    }
  }
  if (result.stable) {
    result.phase_margin_deg = radius < 1 ? phase_margin_deg(binding, h) : 0;
    result.settles_s = radius < 1 ? modes(binding, h).settling_s : 0;
  } else {
    result.growth_per_s = std::log(deciding) / h;
  }
  return result;
}

std::string text(const Verdict& verdict) {
  if (!verdict.unknown.empty()) {
    return fmt::format(
        "no verdict: the law cannot be linearised ({}); whether the loop is stable is not known "
        "before the run",
        verdict.unknown);
  }
  const std::string delay =
      fmt::format("{} tick{} of delay", verdict.delay, verdict.delay == 1 ? "" : "s");
  if (verdict.stable) {
    const std::string limit = verdict.limit_s ? "limit " + period_text(*verdict.limit_s)
                                              : std::string("no stable period found at rest");
    return fmt::format("stable at {} with {}: {}, phase margin {:.0f}°, settles in {:.2g} s",
                       rate_text(verdict.period_s), delay, limit, verdict.phase_margin_deg,
                       verdict.settles_s);
  }
  return fmt::format(
      "unstable at {} with {}: {}, errors grow by e each {}", rate_text(verdict.period_s), delay,
      verdict.limit_s ? "the largest stable period is " + period_text(*verdict.limit_s)
                      : std::string("no sampling period is short enough, the gains do not hold"),
      period_text(1 / verdict.growth_per_s));
}

std::string refusal(const Verdict& verdict, const std::string& scenario_file) {
  const std::string remedy =
      verdict.limit_s ? fmt::format("type --set loop.period_s={:g}", round_below(*verdict.limit_s))
                      : std::string("choose other gains");
  return fmt::format("{}: {}; {} or --force to run it as it is; tachless certify tells more",
                     scenario_file, text(verdict), remedy);
}

}  // namespace tachless::certificate
