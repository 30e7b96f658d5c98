#include "certificate/verdict.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "certificate/certify.h"
#include "certificate/sampled_certificate.h"
#include "controller/registry.h"

namespace tachless::certificate {
namespace {

constexpr double longest_s = 0.5;
constexpr double shortest_s = 1e-7;
constexpr double ratio = 1.3;
constexpr double precision = 2e-3;

/// The largest stable period at or around `period_s`, which `stable` says of itself.
std::optional<double> limit_near(const SampledLoop& loop, double period_s, bool stable) {
  double from = period_s;
  for (; !stable && from > shortest_s; stable = radius_at(loop, from) < 1) from /= ratio;
  if (!stable) return {};
  return largest_stable_period(loop, {from, std::max(longest_s, from), ratio, precision});
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

Verdict verdict(const experiment::Scenario& scenario) {
  Verdict result;
  const controller::law::Settings settings = controller::law_settings(scenario);
  result.period_s = settings.period_s;
  result.delay = settings.command_delay;
  result.unknown = controller::law_facts(scenario.controller.law).no_linearisation;
  if (!result.unknown.empty()) return result;
  const ScenarioLoop loop(scenario);
  const double h = result.period_s;

  constexpr int postures = 5, motion_pieces = 12;
  const std::vector<loop::ReferencePoint> rests = loop.rests(postures);
  double radius = 0;
  std::size_t worst = 0;
  for (std::size_t i = 0; i < rests.size(); ++i) {
    const double here = radius_at(loop.at(rests[i]), h);
    if (here > radius) worst = i;
    radius = std::max(radius, here);
  }
  const double over_motion = loop.moves() ? radius_over_motion(loop, motion_pieces) : radius;
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
    if (radius_at(other, *result.limit_s) >= 1.0 + precision) {
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
