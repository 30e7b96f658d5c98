#include "identify/identify.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/failure.h"
#include "identify/least_squares.h"
#include "robot/urdf_xml.h"

namespace tachless::identify {
namespace {

using Eigen::VectorXd;

/// Least motion of a joint for which its own parameters are identified [rad; m].
constexpr double least_motion = 0.02;
/// Largest share of a joint's peak torque that an interval may leave undetermined.
constexpr double most_open = 0.05;

/// Returns why parameter number i is not identifiable, or "" if it is. One reason is that the joint
/// hardly moves. The other is that the interval reaches zero and covers a good part of the joint's
/// torque. A parameter that is zero within a narrow interval is identifiable.
std::string doubt_about(const Identified::Parameter& of, Eigen::Index i,
                        const std::vector<Recording>& recordings,
                        const std::vector<Regression>& regressions) {
  double range = 0, open = std::numeric_limits<double>::infinity();
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    open = std::min(open, of.half_width * regressions[r].share[i]);
    if (of.entry.joint < 0) continue;
    const auto q = recordings[r].q.col(of.entry.joint);
    range = std::max(range, q.maxCoeff() - q.minCoeff());
  }
  if (of.entry.joint >= 0 && range < least_motion) {
    return fmt::format("the joint moves by {:.2g} only", range);
  }
  if (open < most_open || of.half_width < std::abs(of.value)) return "";
  return fmt::format("its interval reaches zero and is {:.0f} % of the joint's torque", 100 * open);
}

double correlation_of(const VectorXd& x) {
  const Eigen::Index last = x.size() - 1;
  const VectorXd centred = x.array() - x.mean();
  return centred.head(last).dot(centred.tail(last)) / std::max(1e-300, centred.squaredNorm());
}

std::vector<Identified::Check> check(const Recording& recording, const Parameters& parameters,
                                     const VectorXd& values) {
  const Regression torque = regression(recording, parameters);
  const VectorXd before = torque.residual(VectorXd::Zero(values.size())),
                 after = torque.residual(values);
  Eigen::MatrixXd error;
  if (recording.controlled) error = simulated_residual(recording, parameters, values);
  const robot::JointLabels labels = joint_labels(*recording.scenario.model);
  std::vector<Identified::Check> result;
  for (Eigen::Index i = 0; i < before.size(); ++i) {
    const auto at = static_cast<std::size_t>(i);
    const double peak = std::max(1e-300, torque.peak[i]);
    result.push_back(
        {labels.name[at], labels.length[at], before[i] / peak, after[i] / peak, {}, {}});
    if (error.size() == 0) continue;
    const VectorXd of_joint = error.col(i);
    result.back().position_error =
        std::sqrt(of_joint.squaredNorm() / static_cast<double>(of_joint.size()));
    result.back().correlation = correlation_of(of_joint);
  }
  return result;
}

void set_links(const Parameters& parameters, const VectorXd& values,
               const scenario::Scenario& scenario, Identified& to) {
  if (parameters.first(Kind::inertia) < 0) return;
  const scenario::Scenario changed = parameters.plant(scenario, values);
  for (std::size_t i = 0; i < changed.model->bodies.size(); ++i) {
    const robot::Body &before = scenario.model->bodies[i], &after = changed.model->bodies[i];
    to.links.push_back({before.link, before, after});
  }
}

}  // namespace

Identified identify(const std::vector<Recording>& recordings, const std::vector<Kind>& unknown,
                    const std::optional<Recording>& validate, const Report& report) {
  for (const Recording& each : recordings) require_same_robot(recordings.front(), each);
  if (validate) require_same_robot(recordings.front(), *validate);
  const bool simulated = std::ranges::all_of(recordings, &Recording::controlled);
  std::vector<Kind> kinds = unknown;
  // A log's torques are the sent ones; a table's torques are not delayed.
  std::erase(kinds, simulated ? Kind::offset : Kind::delay);
  if (kinds.empty()) {
    throw base::bad_usage(
        "{}: nothing is left to identify: a log has no offset, a table no delay; name another "
        "parameter with --unknown",
        recordings.front().source);
  }
  const Parameters parameters(recordings.front().scenario, kinds);
  report("least squares on filtered positions and torques");
  std::vector<Regression> regressions;
  for (const Recording& each : recordings) regressions.push_back(regression(each, parameters));
  const scenario::Scenario& scenario = recordings.front().scenario;
  LeastSquares answer = least_squares(regressions, parameters, *scenario.model, simulated);
  Identified result;
  result.rank = answer.rank;
  result.condition = answer.condition;
  result.validated = validate.has_value();
  result.simulated = simulated;
  if (simulated) {
    const Fit fit = output_error(recordings, parameters, answer.values, report);
    result.condition = fit.condition;
    answer.values = fit.values;
    answer.half_width = fit.half_width;
  }
  set_links(parameters, answer.values, scenario, result);
  for (Eigen::Index i = 0; i < parameters.size(); ++i) {
    const auto at = static_cast<std::size_t>(i);
    const auto& entry = parameters.entries()[at];
    Identified::Parameter each{entry, answer.values[i], answer.half_width[i], "", false};
    if (!answer.sums[at].empty()) {
      each.in_sum = !result.links.empty();
      each.half_width = std::numeric_limits<double>::infinity();
      each.doubt = answer.sums[at] != "nothing" ? "only in sums with " + answer.sums[at]
                   : entry.kind == Kind::inertia
                       ? "it has no part in any torque"
                       : "the joint hardly moves, or it has no part in any torque";
    } else if (entry.kind != Kind::inertia) {
      each.doubt = doubt_about(each, i, recordings, regressions);
    }
    result.parameters.push_back(std::move(each));
  }
  result.checks = check(validate ? *validate : recordings.front(), parameters, answer.values);
  result.overrides = parameters.overrides(scenario, answer.values);
  return result;
}

std::string urdf_of(const Identified& found, const scenario::Scenario& scenario) {
  if (found.links.empty()) return scenario.robot.urdf_text;
  std::map<std::string, robot::MassProperties> links;
  for (const auto& [name, frame] : scenario.model->frames) {
    if (frame.body >= 0) links[name];  // bodies fixed to a link are part of that link
  }
  for (const Identified::Link& each : found.links) links[each.name] = each.after;
  return robot::urdf_with_inertials(scenario.robot.urdf_text, links);
}

std::string text(const Identified& found, const std::string& name) {
  std::string text =
      fmt::format("{}: 95 % intervals, condition {:.3g}{}\n", name, found.condition,
                  found.simulated ? "" : "; by least squares, as no controller is known");
  for (const Identified::Parameter& each : found.parameters) {
    if (each.entry.kind == Kind::inertia) continue;
    if (each.in_sum) {
      text += fmt::format("  {:<24} {:>10.4g} {}: {}\n", each.entry.name, each.value,
                          each.entry.unit, each.doubt);
      continue;
    }
    text += fmt::format("  {:<24} {:>10.4g} +- {:.2g} {}{}\n", each.entry.name, each.value,
                        each.half_width, each.entry.unit,
                        each.doubt.empty() ? "" : ": not identifiable, " + each.doubt);
  }
  if (!found.links.empty()) {
    const auto alone = std::ranges::count_if(found.parameters, [](const auto& each) {
      return each.entry.kind == Kind::inertia && each.doubt.empty();
    });
    text += fmt::format(
        "  links: of {} numbers {} combinations are determined, {} of the links' alone; the rest "
        "is near the URDF's\n",
        found.parameters.size(), found.rank, alone);
    for (const Identified::Link& each : found.links) {
      text += fmt::format("  {:<24} {:.4g} -> {:.4g} kg, centre [{:.3g}] -> [{:.3g}] m\n",
                          each.name, each.before.mass, each.after.mass,
                          fmt::join(each.before.p_Bcm, ", "), fmt::join(each.after.p_Bcm, ", "));
    }
  }
  text += fmt::format("  torque error on {}, rms over peak, unknowns zero -> identified{}\n",
                      found.validated ? "data not used" : "the same data",
                      found.simulated ? "; position error" : "");
  for (const Identified::Check& each : found.checks) {
    text += fmt::format("  {:<24} {:>6.2f} % -> {:.2f} %", each.joint, 100 * each.before,
                        100 * each.after);
    if (each.position_error) {
      text += fmt::format("; {:.2g} {} rms, correlation {:.2f}", *each.position_error, each.unit,
                          *each.correlation);
    }
    text += "\n";
  }
  return text;
}

void to_json(nlohmann::ordered_json& json, const Identified& found) {
  const auto list = [](const auto& vector) {
    return std::vector<double>(vector.begin(), vector.end());
  };
  const auto mass = [&](const robot::MassProperties& of) -> nlohmann::ordered_json {
    return {{"mass_kg", of.mass},
            {"center_of_mass_m", list(of.p_Bcm)},
            {"inertia_kgm2", list(inertial_of({of.mass, {0, 0, 0}, of.I_Bcm}).tail<6>())}};
  };
  json = {{"method", found.simulated ? "output error" : "least squares"},
          {"condition", found.condition},
          {"combinations", found.rank},
          {"validated", found.validated}};
  for (const Identified::Parameter& each : found.parameters) {
    json["parameters"].push_back({{"name", each.entry.name},
                                  {"unit", each.entry.unit},
                                  {"value", each.value},
                                  {"half_width", each.half_width},
                                  {"identifiable", each.doubt.empty()},
                                  {"doubt", each.doubt}});
  }
  for (const Identified::Link& each : found.links) {
    json["links"].push_back(
        {{"name", each.name}, {"before", mass(each.before)}, {"after", mass(each.after)}});
  }
  for (const Identified::Check& each : found.checks) {
    json["joints"].push_back(
        {{"name", each.joint}, {"torque_error_before", each.before}, {"torque_error", each.after}});
    if (!each.position_error) continue;
    json["joints"].back()["position_error"] = *each.position_error;
    json["joints"].back()["correlation"] = *each.correlation;
  }
  json["overrides"] = found.overrides;
}

}  // namespace tachless::identify
