#include "identify/identify.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "identify/least_squares.h"

namespace tachless::identify {
namespace {

using Eigen::VectorXd;

/// A joint has to move by this much for its own parameters [rad; m].
constexpr double least_motion = 0.02;
/// What an interval may leave open of a joint's largest torque.
constexpr double most_open = 0.05;

/// Why the parameter, number i, is not identifiable: the torque that its interval leaves open is a
/// good part of what the joint does, or the joint hardly moves. A parameter that is zero within a
/// narrow interval is identified.
std::string doubt_about(const Parameters::Entry& entry, Eigen::Index i, double half_width,
                        const std::vector<Recording>& recordings,
                        const std::vector<Regression>& regressions) {
  double range = 0, open = std::numeric_limits<double>::infinity();
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const Regression& torque = regressions[r];
    const VectorXd column = torque.columns.col(i).cwiseAbs();
    double share = 0;
    for (Eigen::Index row = 0; row < column.size(); ++row) {
      share = std::max(share, column[row] / std::max(1e-300, torque.peak[torque.joint[row]]));
    }
    open = std::min(open, half_width * share);
    if (entry.joint < 0) continue;
    const auto q = recordings[r].q.col(entry.joint);
    range = std::max(range, q.maxCoeff() - q.minCoeff());
  }
  if (entry.joint >= 0 && range < least_motion) {
    return fmt::format("the joint moves by {:.2g} only", range);
  }
  if (open < most_open) return "";
  return fmt::format("its interval is {:.0f} % of the joint's torque", 100 * open);
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
  const Eigen::MatrixXd error = simulated_residual(recording, parameters, values);
  const robot::JointLabels labels = joint_labels(*recording.scenario.model);
  std::vector<Identified::Check> result;
  for (Eigen::Index i = 0; i < before.size(); ++i) {
    const auto at = static_cast<std::size_t>(i);
    const double peak = std::max(1e-300, torque.peak[i]);
    const VectorXd of_joint = error.col(i);
    result.push_back({labels.name[at], labels.length[at], before[i] / peak, after[i] / peak,
                      std::sqrt(of_joint.squaredNorm() / static_cast<double>(of_joint.size())),
                      correlation_of(of_joint)});
  }
  return result;
}

}  // namespace

Identified identify(const std::vector<Recording>& recordings, const std::vector<Kind>& unknown,
                    const std::vector<Recording>& validate, const Report& report) {
  for (const Recording& each : recordings) require_same_robot(recordings.front(), each);
  for (const Recording& each : validate) require_same_robot(recordings.front(), each);
  const Parameters parameters(recordings.front().scenario, unknown);
  report("least squares on filtered positions and torques");
  std::vector<Regression> regressions;
  for (const Recording& each : recordings) regressions.push_back(regression(each, parameters));
  const Fit fit = output_error(recordings, parameters, least_squares(regressions), report);
  Identified result;
  result.condition = fit.condition;
  result.validated = !validate.empty();
  for (Eigen::Index i = 0; i < parameters.size(); ++i) {
    const auto& entry = parameters.entries()[static_cast<std::size_t>(i)];
    result.parameters.push_back(
        {entry, fit.values[i], fit.half_width[i],
         doubt_about(entry, i, fit.half_width[i], recordings, regressions)});
  }
  result.checks = check((validate.empty() ? recordings : validate).front(), parameters, fit.values);
  result.overrides = parameters.overrides(fit.values);
  return result;
}

std::string text(const Identified& found, const std::string& name) {
  std::string text = fmt::format("{}: 95 % intervals, condition {:.3g}\n", name, found.condition);
  for (const Identified::Parameter& each : found.parameters) {
    text += fmt::format("  {:<24} {:>10.4g} +- {:.2g} {}{}\n", each.entry.name, each.value,
                        each.half_width, each.entry.unit,
                        each.doubt.empty() ? "" : ": not identifiable, " + each.doubt);
  }
  text += fmt::format(
      "  torque error on {}, rms over peak, unknowns zero -> identified; position error\n",
      found.validated ? "data not used" : "the same data");
  for (const Identified::Check& each : found.checks) {
    text += fmt::format("  {:<24} {:>6.2f} % -> {:.2f} %; {:.2g} {} rms, correlation {:.2f}\n",
                        each.joint, 100 * each.before, 100 * each.after, each.position_error,
                        each.unit, each.correlation);
  }
  return text;
}

void to_json(nlohmann::ordered_json& json, const Identified& found) {
  json = {{"condition", found.condition}, {"validated", found.validated}};
  for (const Identified::Parameter& each : found.parameters) {
    json["parameters"].push_back({{"name", each.entry.name},
                                  {"unit", each.entry.unit},
                                  {"value", each.value},
                                  {"half_width", each.half_width},
                                  {"identifiable", each.doubt.empty()},
                                  {"doubt", each.doubt}});
  }
  for (const Identified::Check& each : found.checks) {
    json["joints"].push_back({{"name", each.joint},
                              {"torque_error_before", each.before},
                              {"torque_error", each.after},
                              {"position_error", each.position_error},
                              {"correlation", each.correlation}});
  }
  json["overrides"] = found.overrides;
}

}  // namespace tachless::identify
