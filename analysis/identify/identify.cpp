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
#include "base/json_text.h"
#include "identify/friction_terms.h"
#include "identify/least_squares.h"
#include "identify/loop_terms.h"
#include "identify/units.h"
#include "robot/urdf_xml.h"

namespace tachless::identify {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Least motion of a joint for which its own parameters are identified [rad; m].
constexpr double least_motion = 0.02;
/// Largest share of a joint's peak torque that an interval may leave undetermined.
constexpr double most_open = 0.05;
/// Largest number of ticks by which a table's torques are moved at once.
constexpr double longest_move = 50;

/// Returns why parameter number i is not identifiable, or "" if it is. One reason is that the joint
/// hardly moves. The other is that the interval reaches zero and leaves more of the joint's torque
/// open than `most_open` and than the largest torque that the fit leaves. A parameter that is zero
/// within a narrower interval is known to be small. A table's delay is not written and not doubted.
/// @param left largest torque that the fit leaves, over the peak of each joint
std::string doubt_about(const Identified::Parameter& parameter, Eigen::Index i,
                        const std::vector<Recording>& recordings,
                        const std::vector<Regression>& regressions, const VectorXd& left) {
  if (parameter.entry.kind == Kind::delay && !parameter.entry.not_negative) return "";
  double range = 0, open = std::numeric_limits<double>::infinity();
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    if (parameter.entry.kind == Kind::load && !recordings[r].loaded) continue;
    open = std::min(open, parameter.half_width * regressions[r].share[i]);
    if (parameter.entry.joint < 0) continue;
    const auto q = recordings[r].q.col(parameter.entry.joint);
    range = std::max(range, q.maxCoeff() - q.minCoeff());
  }
  if (parameter.entry.joint >= 0 && range < least_motion) {
    return fmt::format("the joint moves by {:.2g} only", range);
  }
  const double residual =
      parameter.entry.joint >= 0 ? left[parameter.entry.joint] : left.minCoeff();
  if (open < std::max(most_open, residual) || parameter.half_width < std::abs(parameter.value))
    return "";
  return fmt::format("its interval reaches zero and is {:.0f} % of the joint's torque", 100 * open);
}

/// Returns the rms of the torques that `values` leave, over the peak of each joint.
VectorXd torque_left(const std::vector<Regression>& regressions, const VectorXd& values) {
  VectorXd result = VectorXd::Zero(regressions.front().peak.size());
  for (const Regression& each : regressions) {
    result = result.cwiseMax(each.residual(values).cwiseQuotient(each.peak.cwiseMax(1e-300)));
  }
  return result;
}

/// Returns the largest torque that `values` leave, over the peak of each joint.
VectorXd largest_left(const std::vector<Regression>& regressions, const VectorXd& values) {
  VectorXd result = VectorXd::Zero(regressions.front().peak.size());
  for (const Regression& each : regressions) {
    const VectorXd left = (each.torque - each.columns * values).cwiseAbs();
    for (Eigen::Index row = 0; row < left.size(); ++row) {
      const Eigen::Index j = each.joint[row];
      result[j] = std::max(result[j], left[row] / std::max(1e-300, each.peak[j]));
    }
  }
  return result;
}

/// Returns the rms of the torque that the intervals of all parameters together leave open in the
/// motions, over the peak of each joint. Large changes of single parameters may cancel in it.
VectorXd open_torque(const std::vector<Regression>& regressions, const LeastSquares& answer) {
  constexpr double normal = 1.96;  // quantile of a 95 % interval
  VectorXd result = VectorXd::Zero(regressions.front().peak.size());
  for (const Regression& each : regressions) {
    const VectorXd rms = each.rms(normal * (each.columns * answer.moves).rowwise().norm());
    result = result.cwiseMax(rms.cwiseQuotient(each.peak.cwiseMax(1e-300)));
  }
  return result;
}

/// Returns what a motion must have to determine a parameter.
std::string advice_on(const Identified::Parameter& parameter, const std::string& joint) {
  if (parameter.entry.joint >= 0 && parameter.doubt.starts_with("the joint")) {
    return fmt::format(
        "motion of {} (a joint that friction holds moves with a guess of it: run with --set "
        "controller.friction.coulomb=…)",
        joint);
  }
  switch (parameter.entry.kind) {
    case Kind::rotor:
      return fmt::format("more acceleration of {}", joint);
    case Kind::viscous:
      return fmt::format("more speed of {}", joint);
    case Kind::coulomb:
    case Kind::rise:
      return fmt::format("motion of {} both ways, slowly and fast", joint);
    case Kind::delay:
      return "more speed";
    case Kind::load:
      return "postures in which gravity pulls at the payload differently, and a run without it "
             "(--without)";
    case Kind::payload:
    case Kind::inertia:
    case Kind::offset:
    case Kind::load_friction:
      break;
  }
  return "postures in which gravity pulls differently";
}

/// Checks values on recordings. The recording with a joint's largest error counts.
/// @param position_errors of the recordings, if their loops can be simulated
std::vector<Identified::Check> check(const std::vector<Regression>& regressions,
                                     const robot::JointLabels& labels, const VectorXd& values,
                                     const std::vector<MatrixXd>& position_errors) {
  std::vector<Identified::Check> result;
  for (std::size_t i = 0; i < labels.name.size(); ++i) {
    result.push_back({labels.name[i], labels.length[i], 0, 0, {}, {}});
  }
  for (std::size_t r = 0; r < regressions.size(); ++r) {
    const VectorXd before = torque_left({regressions[r]}, VectorXd::Zero(values.size())),
                   after = torque_left({regressions[r]}, values);
    for (std::size_t i = 0; i < result.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      result[i].before = std::max(result[i].before, before[at]);
      result[i].after = std::max(result[i].after, after[at]);
      if (position_errors.empty()) continue;
      const VectorXd error = position_errors[r].col(at);
      result[i].position_error =
          std::max(result[i].position_error.value_or(0),
                   error.norm() / std::sqrt(static_cast<double>(error.size())));
    }
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

namespace {

/// Values, intervals and tests that the recordings give.
struct Answer : LeastSquares {
  std::vector<Misfit> misfits;
  std::vector<Recording> recordings;  ///< with a table's torques moved to where they act
  std::vector<Regression> regressions;
  std::vector<MatrixXd> position_errors;  ///< of simulated loops
  Fit fit{};                              ///< of simulated loops
};

std::vector<Regression> regressions_of(const std::vector<Recording>& recordings,
                                       const Parameters& parameters) {
  std::vector<Regression> result;
  for (const Recording& each : recordings) result.push_back(regression(each, parameters));
  return result;
}

/// Moves the v_r of the rises to where the residual is least, as far as that is linear. A joint at
/// which the model lacks something for all that gets the v_r again that blocks of time chose: it
/// predicts other motions better.
class Turning {
 public:
  explicit Turning(Parameters& parameters) : chosen_(parameters) { parameters.free_velocities(); }

  /// Changes v_r in `parameters`, for which `found` is the answer.
  /// @return the largest change, over v_r; 1 if a v_r is known from now on
  double turn(const TableAnswer& found, Parameters& parameters) {
    constexpr int patience = 3;
    ++calls_;
    double largest = 0;
    for (Eigen::Index i = 0, at = 0; i < parameters.size(); ++i) {
      const Parameters::Entry& entry = parameters.entries()[static_cast<std::size_t>(i)];
      if (!entry.turns) continue;
      const double change = found.turns[at++] / found.values[i], v = entry.velocity,
                   first = chosen(i).velocity;
      const Misfit& misfit = found.misfits[static_cast<std::size_t>(entry.joint)];
      if (!std::isfinite(change) || (calls_ > patience && is_misfit(misfit))) {
        parameters.set_velocity(i, first, false);
        largest = 1;
        continue;
      }
      const double next = nearby(v, change, first);
      largest = std::max(largest, std::abs(next - v) / v);
      parameters.set_velocity(i, next, true);
    }
    return largest;
  }

 private:
  [[nodiscard]] const Parameters::Entry& chosen(Eigen::Index i) const {
    return chosen_.entries()[static_cast<std::size_t>(i)];
  }
  static double nearby(double v, double change, double first) {
    constexpr double most_step = 0.3, farthest = 2;
    const double next = v * (1 + std::clamp(change / v, -most_step, most_step));
    return std::clamp(next, first / farthest, first * farthest);
  }

  Parameters chosen_;
  int calls_ = 0;
};

/// Identifies from tables. The delay of their torques and the v_r of a rise are linear in small
/// changes only. The torques are moved, and v_r is changed, until little is left.
Answer answer_of_tables(const std::vector<Recording>& recordings, Parameters& parameters) {
  constexpr int most_moves = 8;
  constexpr double little = 0.01;  // [ticks], and share of v_r
  const robot::Model& model = *recordings.front().scenario.model;
  const Eigen::Index delay = parameters.first(Kind::delay);
  Turning turning(parameters);
  std::vector<Recording> moved = recordings;
  for (int move = 0;; ++move) {
    std::vector<Regression> regressions = regressions_of(moved, parameters);
    TableAnswer found = table_answer(regressions, parameters, model);
    const double now = moved.front().moved;
    const double more =
        delay < 0 ? 0 : std::clamp(found.values[delay] - now, -longest_move, longest_move);
    Parameters next = parameters;
    const double turned = turning.turn(found, next);
    if ((std::abs(more) < little && turned < little) || move == most_moves) {
      return {found, std::move(found.misfits), std::move(moved), std::move(regressions), {}};
    }
    parameters = std::move(next);
    for (std::size_t i = 0; delay >= 0 && i < moved.size(); ++i) {
      moved[i] = with_torques_moved(recordings[i], now + more);
    }
  }
}

/// Returns whether a delay should not be taken out of tables: the model lacks something, and the
/// delay is not clearly told from zero. What the model lacks may look like a delay.
bool delay_is_doubtful(const Answer& answer, const Parameters& parameters) {
  constexpr double clear = 3;  // half widths of the 95 % interval
  const Eigen::Index delay = parameters.first(Kind::delay);
  return delay >= 0 && parameters.size() > 1 && std::ranges::any_of(answer.misfits, is_misfit) &&
         !(clear * answer.half_width[delay] < std::abs(answer.values[delay]));
}

/// Adds the further terms of friction that tables ask for to the parameters and to the answer.
void add_friction_terms(const std::vector<Recording>& recordings, const std::vector<Kind>& kinds,
                        Parameters& parameters, Answer& answer) {
  if (parameters.first(Kind::viscous) < 0 || parameters.first(Kind::coulomb) < 0) return;
  std::vector<FrictionTerm> terms =
      friction_terms(answer.recordings, answer.regressions, parameters, answer.values);
  while (!terms.empty()) {
    Parameters with(recordings.front().scenario, kinds, false, terms);
    Answer found = answer_of_tables(recordings, with);
    std::vector<FrictionTerm> kept = kept_terms(terms, with, found);
    if (kept.size() == terms.size()) {
      parameters = std::move(with);
      answer = std::move(found);
      return;
    }
    terms = std::move(kept);
  }
}

/// Identifies from logs. Moves the v_r that are unknown to those of the answer.
/// @param start values from which the simulated loop is fitted; empty: those of least squares
Answer answer_of_logs(const std::vector<Recording>& recordings, Parameters& parameters,
                      const VectorXd& start, const Report& report) {
  std::vector<Regression> regressions = regressions_of(recordings, parameters);
  const robot::Model& model = *recordings.front().scenario.model;
  const std::vector<RowUse> rows = rows_of(parameters, model.num_joints);
  Answer answer{least_squares(regressions, parameters, model, rows),
                {},
                recordings,
                std::move(regressions),
                {}};
  answer.fit =
      output_error(recordings, parameters, start.size() > 0 ? start : answer.values, report);
  const Fit& fit = answer.fit;
  // The rank stays that of the regression, as the sums are.
  const Eigen::Index rank = answer.rank;
  static_cast<Precision&>(answer) = fit;
  answer.rank = rank;
  answer.values = fit.values;
  if (parameters.num_turning() > 0) {
    parameters.set_velocities(fit.velocities);
    answer.regressions = regressions_of(recordings, parameters);
  }
  for (std::size_t i = 0; i < answer.sums.size(); ++i) {
    if (answer.sums[i].empty()) continue;
    answer.half_width[static_cast<Eigen::Index>(i)] = std::numeric_limits<double>::infinity();
  }
  for (std::size_t i = 0; i < recordings.size(); ++i) {
    answer.position_errors.push_back(
        simulated_residual(recordings[i], parameters, fit.values, fit.noise[i]));
    answer.misfits = worse(std::move(answer.misfits),
                           position_misfits(recordings[i], answer.position_errors[i]));
  }
  return answer;
}

/// Further terms of friction of logs, on the way to an answer.
struct TermsOnTrial {
  std::vector<FrictionTerm> terms;
  std::size_t old;  ///< number of the first terms, which were there before
  VectorXd start;   ///< values from which the loop is fitted, those of the terms at the end

  /// Takes the v_r of an answer, and removes the terms that it does not keep: those that
  /// `kept_terms` removes, and new ones whose joint's error in blocks of time that were not fitted
  /// has not fallen.
  /// @return whether all are kept
  bool keep(const Parameters& parameters, const Answer& before, const Answer& found) {
    constexpr double most = 1 - least_loop_gain;  // of the error
    const std::vector<FrictionTerm> clear = kept_terms(terms, parameters, found);
    const VectorXd error = held_out_error(found.fit), other = held_out_error(before.fit);
    const Eigen::Index first = parameters.size() - std::ssize(terms);
    start = found.values;
    for (std::size_t t = terms.size(); t-- > 0;) {
      FrictionTerm& term = terms[t];
      const Eigen::Index at = first + static_cast<Eigen::Index>(t);
      const bool is_clear = std::ranges::any_of(clear, [&](const FrictionTerm& each) {
        return each.kind == term.kind && each.joint == term.joint;
      });
      term.velocity = parameters.entries()[static_cast<std::size_t>(at)].velocity;
      if (is_clear && (t < old || error[term.joint] < most * other[term.joint])) continue;
      terms.erase(terms.begin() + static_cast<std::ptrdiff_t>(t));
      const Eigen::Index after = start.size() - at - 1;
      start.segment(at, after) = VectorXd(start.tail(after));
      start.conservativeResize(start.size() - 1);
      if (t < old) --old;
    }
    return std::ssize(terms) == parameters.size() - first;
  }
};

/// Returns the joints at which the model may lack something: what it leaves is correlated, even if
/// the encoders' counts are larger.
std::vector<int> joints_to_search(const std::vector<Misfit>& misfits) {
  constexpr double least_correlation = 0.1;
  std::vector<int> result;
  for (std::size_t i = 0; i < misfits.size(); ++i) {
    if (misfits[i].correlation > least_correlation) result.push_back(static_cast<int>(i));
  }
  return result;
}

/// Fits the loop with terms on trial until each of them is kept.
/// @return whether there are new ones; otherwise nothing changes
bool try_terms(const std::vector<Recording>& recordings, const std::vector<Kind>& kinds,
               TermsOnTrial& trial, Parameters& parameters, Answer& answer, const Report& report) {
  while (trial.terms.size() > trial.old) {
    Parameters with(recordings.front().scenario, kinds, true, trial.terms);
    with.free_velocities();
    Answer found = answer_of_logs(recordings, with, trial.start, report);
    if (!trial.keep(with, answer, found)) continue;
    parameters = std::move(with);
    answer = std::move(found);
    return true;
  }
  return false;
}

/// Adds the further terms of friction that logs ask for to the parameters and to the answer.
void add_friction_terms_of_logs(const std::vector<Recording>& recordings,
                                const std::vector<Kind>& kinds, Parameters& parameters,
                                Answer& answer, const Report& report) {
  constexpr int most_rounds = 2;
  if (parameters.first(Kind::viscous) < 0 || parameters.first(Kind::coulomb) < 0) return;
  std::vector<FrictionTerm> terms;
  for (int round = 0; round < most_rounds; ++round) {
    const std::vector<int> joints = joints_to_search(answer.misfits);
    if (joints.empty()) return;
    report("simulating loops with further terms of friction");
    const LoopTerms more =
        loop_terms(recordings, answer.regressions, answer.fit, kinds, terms, joints);
    TermsOnTrial trial{terms, terms.size(), more.start};
    trial.terms.insert(trial.terms.end(), more.terms.begin(), more.terms.end());
    if (!try_terms(recordings, kinds, trial, parameters, answer, report)) return;
    terms = std::move(trial.terms);
  }
}

/// Adds the parameters, with what is in doubt about them and what would help.
void set_parameters(const Answer& answer, const Parameters& parameters, Identified& to) {
  const VectorXd left = largest_left(answer.regressions, answer.values);
  const VectorXd open = open_torque(answer.regressions, answer);
  const std::vector<bool> bounded = at_bound(parameters, answer.values);
  for (Eigen::Index i = 0; i < parameters.size(); ++i) {
    const auto at = static_cast<std::size_t>(i);
    const auto& entry = parameters.entries()[at];
    Identified::Parameter each{entry,
                               answer.values[i],
                               answer.half_width[i],
                               "",
                               false,
                               bounded[at],
                               answer.by_prior[at] && answer.sums[at].empty() && !to.links.empty()};
    if (!answer.sums[at].empty()) {
      const bool load = entry.kind == Kind::load;
      each.in_sum = load ? entry.component > 0 : !to.links.empty();
      each.half_width = std::numeric_limits<double>::infinity();
      each.doubt = answer.sums[at] != "nothing" ? "only in sums with " + answer.sums[at]
                   : entry.kind == Kind::load   ? "it is not told from the link that carries it"
                   : entry.kind == Kind::inertia
                       ? "it has no part in any torque"
                       : "the joint hardly moves, or it has no part in any torque";
    } else if (entry.kind != Kind::inertia && (entry.kind != Kind::load || entry.component == 0)) {
      each.doubt = doubt_about(each, i, answer.recordings, answer.regressions, left);
      // With links unknown, motions of an arm leave many parameters in sums, or nearly so. The sums
      // may predict the joint's torque all the same.
      each.in_sum = !to.links.empty() && entry.kind != Kind::load && entry.joint >= 0 &&
                    each.doubt.starts_with("its interval") &&
                    open[entry.joint] < std::max(most_open, left[entry.joint]);
      if (each.in_sum) each.doubt += "; its sums with the links' numbers are determined";
    }
    if (!each.doubt.empty() && !each.in_sum) {
      const auto& names = answer.recordings.front().scenario.model->joint_names;
      const std::string advice =
          advice_on(each, entry.joint < 0 ? "" : names[static_cast<std::size_t>(entry.joint)]);
      if (std::ranges::find(to.advice, advice) == to.advice.end()) to.advice.push_back(advice);
    }
    to.parameters.push_back(std::move(each));
  }
}

/// Returns why tables do not fit the robot, or "" if they do.
std::string why_no_fit(const Answer& answer) {
  // A recording of a joint at rest has a small peak, and friction at rest is not modelled.
  VectorXd left = VectorXd::Zero(answer.regressions.front().peak.size()), peak = left;
  for (const Regression& each : answer.regressions) {
    left = left.cwiseMax(each.residual(answer.values));
    peak = peak.cwiseMax(each.peak);
  }
  left = left.cwiseQuotient(peak.cwiseMax(1e-300));
  const std::string remedy = remedy_of(answer.recordings.front(), left);
  if (left.maxCoeff() < no_fit && remedy.empty()) return "";
  return fmt::format(
      "the table does not fit the robot: the fit leaves {:.0f} % of a joint's peak torque; {}",
      100 * left.maxCoeff(),
      remedy.empty() ? "check units, signs and order of its columns, and the scenario's URDF, base "
                       "and gravity"
                     : "its torques fit with " + remedy);
}

/// Checks the answer on the recordings, or on one that was not used.
void set_checks(const Answer& answer, const Parameters& parameters,
                const std::optional<Recording>& validate, Identified& to) {
  const robot::JointLabels labels = joint_labels(*answer.recordings.front().scenario.model);
  if (validate) {
    const double moved = answer.recordings.front().moved;
    const Recording other =
        moved == 0 || validate->controlled ? *validate : with_torques_moved(*validate, moved);
    std::vector<MatrixXd> error;
    if (to.simulated && other.controlled) {
      error.push_back(simulated_residual(other, parameters, answer.values));
    }
    to.checks = check({regression(other, parameters)}, labels, answer.values, error);
  } else {
    to.checks = check(answer.regressions, labels, answer.values, answer.position_errors);
  }
  for (std::size_t i = 0; i < to.checks.size(); ++i) to.checks[i].misfit = answer.misfits[i];
}

}  // namespace

Identified identify(const std::vector<Recording>& recordings, const std::vector<Kind>& unknown,
                    const std::optional<Recording>& validate, const Report& report) {
  for (const Recording& each : recordings) require_same_robot(recordings.front(), each);
  if (validate) require_same_robot(recordings.front(), *validate);
  const bool simulated = std::ranges::all_of(recordings, &Recording::controlled);
  std::vector<Kind> kinds = unknown;
  const bool tables = std::ranges::none_of(recordings, &Recording::controlled);
  if (simulated) std::erase(kinds, Kind::offset);             // a log's torques are the sent ones
  if (!simulated && !tables) std::erase(kinds, Kind::delay);  // tables and logs have different ones
  if (kinds.empty()) {
    throw base::bad_usage(
        "{}: nothing is left to identify: a log has no offset, a log beside a table no "
        "delay; name another parameter with "
        "--unknown",
        recordings.front().source);
  }
  Parameters parameters(recordings.front().scenario, kinds, simulated);
  report("least squares on filtered positions and torques");
  Answer answer = simulated ? answer_of_logs(recordings, parameters, {}, report)
                            : answer_of_tables(recordings, parameters);
  if (tables && delay_is_doubtful(answer, parameters)) {
    std::erase(kinds, Kind::delay);
    parameters = Parameters(recordings.front().scenario, kinds, simulated);
    answer = answer_of_tables(recordings, parameters);
  }
  if (tables) add_friction_terms(recordings, kinds, parameters, answer);
  if (simulated) add_friction_terms_of_logs(recordings, kinds, parameters, answer, report);
  const scenario::Scenario& scenario = recordings.front().scenario;
  Identified result;
  result.rank = answer.rank;
  result.condition = answer.condition;
  result.validated = validate.has_value();
  result.simulated = simulated;
  set_links(parameters, answer.values, scenario, result);
  set_parameters(answer, parameters, result);
  set_checks(answer, parameters, validate, result);
  if (tables) result.no_fit = why_no_fit(answer);
  result.overrides = parameters.overrides(scenario, answer.values);
  if (parameters.first(Kind::load) >= 0) {
    result.load = load_of(answer, answer.values, parameters, scenario.plant.payload.link);
    result.overrides.push_back(override_of(*result.load));
  }
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

namespace {

/// Returns the function of velocity that a rise is the factor of, or "" for others.
std::string over(const Parameters::Entry& entry) {
  return entry.kind == Kind::rise ? fmt::format(", of tanh(v / {:.3g})", entry.velocity) : "";
}

/// Returns the sentences on what the model lacks.
std::string remarks(const Identified& found) {
  std::vector<std::string> joints;
  std::string text;
  for (const Identified::Check& each : found.checks) {
    if (each.misfit.found) joints.push_back(each.joint);
  }
  if (!joints.empty()) {
    text += fmt::format("  the model lacks something at {}; {} intervals do not hold\n",
                        fmt::join(joints, ", "), joints.size() > 1 ? "their" : "its");
  }
  for (const Identified::Check& each : found.checks) {
    if (each.misfit.slow_friction == 0) continue;
    text += fmt::format(
        "  friction of {} is not viscous + Coulomb: slow and fast motion differ "
        "by {:.2g}\n",
        each.joint, std::abs(each.misfit.slow_friction));
  }
  return text;
}

}  // namespace

std::string text(const Identified& found, const std::string& name) {
  std::string text =
      fmt::format("{}: 95 % intervals, condition number {:.3g}{}\n", name, found.condition,
                  found.simulated ? "" : "; by least squares, as no controller is known");
  for (const Identified::Parameter& each : found.parameters) {
    const bool in_load = each.entry.kind == Kind::load && each.doubt.empty();
    if (each.entry.kind == Kind::inertia || in_load || each.entry.component > 0) continue;
    if (each.in_sum) {
      text += fmt::format("  {:<24} {:>10.4g} {}: {}\n", each.entry.name, each.value,
                          each.entry.unit, each.doubt);
      continue;
    }
    text += fmt::format("  {:<24} {:>10.4g} {} {:.2g} {}{}{}\n", each.entry.name, each.value,
                        each.at_bound ? "to" : "+-", each.half_width,
                        each.entry.unit + over(each.entry),
                        !each.doubt.empty() ? ": not identifiable, " + each.doubt
                        : each.is_small()   ? ": small, not told from zero"
                                            : "",
                        each.by_urdf ? "; by the URDF's links" : "");
  }
  if (found.load) text += identify::text(*found.load);
  if (!found.links.empty()) {
    const auto alone = std::ranges::count_if(found.parameters, [](const auto& each) {
      return each.entry.kind == Kind::inertia && each.doubt.empty() && !each.by_urdf;
    });
    const auto by_urdf = std::ranges::count_if(found.parameters, &Identified::Parameter::by_urdf);
    text += fmt::format(
        "  links: of {} numbers {} combinations are determined, {} of the links' alone; the rest "
        "is near the URDF's; {} numbers are determined mainly by the URDF's links and not by the "
        "data\n",
        found.parameters.size(), found.rank, alone, by_urdf);
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
    text += fmt::format(
        "  {:<24} {:>6.2f} % -> {:.2f} %{}, correlation {:.2f}{}\n", each.joint, 100 * each.before,
        100 * each.after,
        each.position_error ? fmt::format("; {:.2g} {} rms", *each.position_error, each.unit) : "",
        each.misfit.correlation, each.misfit.found ? ", misfit" : "");
  }
  return text + remarks(found);
}

void to_json(nlohmann::ordered_json& json, const Identified& found) {
  using base::json_list;
  const auto mass = [&](const robot::MassProperties& link) -> nlohmann::ordered_json {
    return {{"mass_kg", link.mass},
            {"center_of_mass_m", json_list(link.p_Bcm)},
            {"inertia_kgm2", json_list(inertial_of({link.mass, {0, 0, 0}, link.I_Bcm}).tail<6>())}};
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
                                  {"at_bound", each.at_bound},
                                  {"small", each.is_small()},
                                  {"by_urdf", each.by_urdf},
                                  {"doubt", each.doubt}});
    if (each.entry.kind == Kind::rise) {
      json["parameters"].back()["velocity"] = each.entry.velocity;
    }
  }
  if (found.load) to_json(json["payload"], *found.load);
  for (const Identified::Link& each : found.links) {
    json["links"].push_back(
        {{"name", each.name}, {"before", mass(each.before)}, {"after", mass(each.after)}});
  }
  for (const Identified::Check& each : found.checks) {
    json["joints"].push_back(
        {{"name", each.joint}, {"torque_error_before", each.before}, {"torque_error", each.after}});
    nlohmann::ordered_json& joint = json["joints"].back();
    if (each.position_error) joint["position_error"] = *each.position_error;
    joint["correlation"] = each.misfit.correlation;
    joint["misfit"] = each.misfit.found;
    joint["slow_friction"] = each.misfit.slow_friction;
  }
  json["no_fit"] = found.no_fit;
  json["overrides"] = found.overrides;
}

}  // namespace tachless::identify
