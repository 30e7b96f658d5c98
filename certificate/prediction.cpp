#include "certificate/prediction.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "controller/registry.h"
#include "diagnostics/text.h"
#include "process/parallel.h"

namespace tachless::certificate {
namespace {

using diagnostics::period_text;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using loop::ReferencePoint;
using process::parallel_map;

constexpr int motion_pieces = 96;
constexpr double shortest_s = 1e-7, longest_s = 1;
constexpr double period_ratio = 1.1, limit_precision = 1e-6;

/// The first unstable period above a stable `from_s`, or the last stable one below an unstable one.
std::optional<double> limit_next_to(const SampledLoop& loop, double from_s) {
  double inside = from_s;
  while (radius_at(loop, inside) >= 1) {
    inside /= period_ratio;
    if (inside < shortest_s) return {};
  }
  return largest_stable_period(
      loop, {inside, std::max(inside, longest_s), period_ratio, limit_precision});
}

/// The least limit over the postures and where: from the posture that is the least stable at the
/// scenario's period on, and then of each that is unstable at the least found so far.
void find_limit(Prediction& result, const std::vector<SampledLoop>& loops,
                const std::vector<ReferencePoint>& rests, std::size_t first) {
  result.limit_s = limit_next_to(loops[first], result.settings.period_s);
  result.limit_q = rests[first].q_ref;
  for (std::size_t round = 0; round < loops.size() && result.limit_s; ++round) {
    const std::vector<double> radius = parallel_map(
        loops.size(), [&](std::size_t i) { return radius_at(loops[i], *result.limit_s); });
    const auto worst = std::ranges::max_element(radius);
    if (*worst < 1) break;
    const auto i = static_cast<std::size_t>(worst - radius.begin());
    result.limit_s = limit_next_to(loops[i], *result.limit_s);
    result.limit_q = rests[i].q_ref;
  }
}

MatrixXd power(MatrixXd base, std::int64_t exponent) {
  MatrixXd result = MatrixXd::Identity(base.rows(), base.cols());
  for (; exponent > 0; exponent /= 2) {
    if (exponent % 2 == 1) result = base * result;
    base = base * base;
  }
  return result;
}

/// Per period over the motion, in pieces each of which stands for equally many periods.
double radius_over_motion(const ScenarioLoop& loop) {
  const double h = loop.settings().period_s;
  const ScenarioLoop::Motion& motion = loop.motion();
  const auto ticks = std::max<std::int64_t>(1, std::llround((motion.end_s - motion.begin_s) / h));
  const auto count = std::min<std::int64_t>(motion_pieces, ticks);
  const auto first_tick = [&](std::int64_t k) { return k * ticks / count; };
  const std::vector<MatrixXd> maps =
      parallel_map(static_cast<std::size_t>(count), [&](std::size_t i) {
        const auto k = static_cast<std::int64_t>(i);
        const std::int64_t begin = first_tick(k), length = first_tick(k + 1) - begin;
        const double middle = static_cast<double>(begin) + static_cast<double>(length - 1) / 2;
        return power(loop.map_at(motion.begin_s + h * middle), length);
      });
  const double over_pieces = radius_along([&](int k) { return maps[static_cast<std::size_t>(k)]; },
                                          static_cast<int>(count));
  return std::pow(over_pieces, static_cast<double>(count) / static_cast<double>(ticks));
}

void find_margins(Prediction& result, const std::vector<SampledLoop>& loops,
                  const std::vector<ReferencePoint>& rests) {
  const std::vector<Margins> all = parallel_map(
      loops.size(), [&](std::size_t i) { return margins(loops[i], result.settings.period_s); });
  const auto least = [&](double Margins::*one) {
    return (*std::ranges::min_element(all, {}, one)).*one;
  };
  result.margins =
      Margins{least(&Margins::modulus), least(&Margins::modulus_independent), least(&Margins::gain),
              least(&Margins::phase_deg), least(&Margins::delay_s)};
  const auto at = std::ranges::min_element(all, {}, &Margins::modulus) - all.begin();
  result.margin_q = rests[static_cast<std::size_t>(at)].q_ref;
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

double Prediction::growth_per_s() const { return std::log(radius) / settings.period_s; }

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

Prediction analyse(const experiment::Scenario& scenario, Effort effort, const OnProgress& tell) {
  Prediction result;
  result.settings = controller::law_settings(scenario);
  result.unknown = controller::law_facts(scenario.controller.law).no_linearisation;
  if (!result.unknown.empty()) return result;
  const double h = result.settings.period_s;

  tell("sampled loop: largest period");
  const ScenarioLoop scenario_loop(scenario);
  const std::vector<ReferencePoint> rests = scenario_loop.rest_points(reference_postures);
  const std::vector<SampledLoop> loops =
      parallel_map(rests.size(), [&](std::size_t i) { return scenario_loop.at(rests[i]); });
  const std::vector<double> radius =
      parallel_map(loops.size(), [&](std::size_t i) { return radius_at(loops[i], h); });
  const auto slowest = static_cast<std::size_t>(std::ranges::max_element(radius) - radius.begin());
  find_limit(result, loops, rests, slowest);
  if (radius[slowest] >= 1) result.unstable_q = rests[slowest].q_ref;
  const std::vector<Modes> all =
      parallel_map(loops.size(), [&](std::size_t i) { return modes(loops[i], h); });
  result.modes = all[slowest];
  const Modes& longest = *std::ranges::max_element(all, {}, &Modes::settling_s);
  result.modes.settling_s = longest.settling_s;
  result.modes.settling_mean_s = longest.settling_mean_s;

  tell("sampled loop: along the reference");
  const bool ends = !scenario_loop.motion().repeats;
  result.radius = scenario_loop.moves() ? radius_over_motion(scenario_loop) : 0;
  if (ends) result.radius = std::max(result.radius, radius.back());
  result.stable = result.radius < 1;

  result.gain_Nm_per_rad = own_gain(loops[0].law(h));
  if (scenario.plant.encoder.resolution_bits) {
    result.count_Nm = result.gain_Nm_per_rad.cwiseProduct(
        VectorXd(experiment::encoder_count(scenario, *scenario.model)));
  }
  if (effort == Effort::full && result.unstable_q.size() == 0) {
    tell("sampled loop: margins");
    find_margins(result, loops, rests);
  }
  return result;
}

std::string limit_text(const std::optional<double>& limit_s) {
  if (!limit_s) return "none: unstable at any period";
  return *limit_s >= longest_s ? "1 s or more" : period_text(*limit_s);
}

std::string settling_text(double seconds) { return fmt::format("{:.2g} s", seconds); }

std::string margins_text(const Margins& margins) {
  return fmt::format(
      "gain {}, phase {:.0f} deg, delay {}",
      std::isinf(margins.gain) ? "without limit" : fmt::format("{:.3g}", margins.gain),
      margins.phase_deg,
      std::isinf(margins.delay_s) ? "without limit" : period_text(margins.delay_s));
}

std::string modulus_text(const Margins& margins) {
  return fmt::format("{:.2g} (common to all torques), {:.2g} (independent)", margins.modulus,
                     margins.modulus_independent);
}

std::string list_text(const VectorXd& values) {
  // Rounding, such as sin(pi) = 1e-16, is shown as 0.
  const VectorXd shown = (values.array().abs() < 1e-12).select(0.0, values);
  return fmt::format("[{:.4g}]", fmt::join(shown.begin(), shown.end(), ", "));
}

std::string text(const Prediction& prediction) {
  if (!prediction.unknown.empty()) {
    return fmt::format(
        "no prediction: the law cannot be linearised ({}); whether the loop is stable is not known "
        "before the run",
        prediction.unknown);
  }
  const int ticks = prediction.settings.command_delay;
  const std::string at =
      fmt::format("at {} with {} tick{} of delay", rate_text(prediction.settings.period_s), ticks,
                  ticks == 1 ? "" : "s");
  const std::string limit = limit_text(prediction.limit_s);
  if (!prediction.stable) {
    return fmt::format("unstable {}: largest stable period {}, errors grow by e each {}", at, limit,
                       period_text(1 / prediction.growth_per_s()));
  }
  if (prediction.unstable_q.size() > 0) {
    return fmt::format(
        "stable {} along the motion, but not at rest at q = {}; largest stable period at rest {}",
        at, list_text(prediction.unstable_q), limit);
  }
  return fmt::format("stable {}: limit {}, settles in {}", at, limit,
                     settling_text(prediction.modes.settling_s));
}

std::string refusal(const Prediction& prediction, const std::string& scenario_file) {
  const std::string remedy = prediction.limit_s ? fmt::format("type --set loop.period_s={:g}",
                                                              round_below(*prediction.limit_s))
                                                : std::string("choose other gains");
  return fmt::format("{}: {}; {} or --force to run it as it is; tachless certify prints more",
                     scenario_file, text(prediction), remedy);
}

}  // namespace tachless::certificate
