#include "design/design_problem.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <string>
#include <string_view>
#include <utility>

#include "base/failure.h"
#include "base/parallel.h"
#include "linear/linear_loop.h"
#include "numerics/decompositions.h"
#include "numerics/postures.h"
#include "robot/dynamics.h"

namespace tachless::design {

namespace {

using base::ExitCode;
using base::Failure;
using base::parallel_map;
using controller::law::Tuning;
using Eigen::Index;
using Eigen::VectorXd;
using messages::ReferencePoint;

// Numbers of postures along the reference's motion with which a search begins. The search adds the
// postures that lack the margin or settle last. Three are the ends and the middle of a motion
// between two points.
constexpr int settling_postures = 3, margin_postures = 4;
// Step of a gain's logarithm for derivatives. Their error is half of the step, and rounding adds
// some 1e-12 of the largest entry.
constexpr double gain_difference = 1e-4;
// Factor by which an external law's gains may change: 10 on the bandwidth, which goes with the root
// of kp.
constexpr double most_factor = 100;

/// Returns the geometric mean over the postures of m_j = 1 / (M^-1)_jj, or of M_jj if `held`.
Vector mean_of_inertia(const robot::Model& model, const std::vector<ReferencePoint>& rests,
                       bool held) {
  Vector sum = Vector::Zero(model.num_joints);
  for (const ReferencePoint& rest : rests) {
    const Eigen::MatrixXd M = robot::mass_matrix(model, rest.q_ref);
    const VectorXd own =
        held ? VectorXd(M.diagonal()) : VectorXd(numerics::inverse(M).diagonal().cwiseInverse());
    sum.array() += own.array().log();
  }
  return (sum / static_cast<double>(rests.size())).array().exp();
}

Matrix mean_matrix(const robot::Model& model, const std::vector<ReferencePoint>& rests) {
  Matrix sum = Matrix::Zero(model.num_joints, model.num_joints);
  for (const ReferencePoint& rest : rests) sum += robot::mass_matrix(model, rest.q_ref);
  return sum / static_cast<double>(rests.size());
}

/// Returns the tuning for inertias of 1.
Tuning tuning_of(const scenario::Scenario& scenario) {
  Tuning tuning;
  tuning.inertia = Vector::Ones(scenario.num_joints);
  tuning.period_s = scenario.loop.period_s;
  if (const auto& drive = scenario.robot.flexible) {
    tuning.stiffness = drive->stiffness;
    tuning.rotor = drive->rotor_inertia;
  }
  return tuning;
}

const controller::LawFacts& tuned_law(const std::string& name) {
  const controller::LawFacts& law = controller::law_facts(name);
  if (law.tuned) return law;
  throw Failure(ExitCode::check_said_no, "{} has no rule for its gains: tune it by hand", name);
}

/// Returns whether the gain is the b of a filter b p / (p + a), of which only kd b counts.
bool is_filter_gain(std::string_view name) { return name == "b" || name == "b1" || name == "b2"; }

/// Returns the derivative by differences. Returns 0 when the number of states changes, which
/// happens at a gain where a pole vanishes.
linear::LinearLaw difference(const linear::LinearLaw& to, const linear::LinearLaw& from) {
  const double by = to.A.rows() == from.A.rows() ? 1 / gain_difference : 0;
  if (by == 0) return {0 * from.A, 0 * from.B, 0 * from.C, 0 * from.D, from.measured};
  return {by * (to.A - from.A), by * (to.B - from.B), by * (to.C - from.C), by * (to.D - from.D),
          to.measured};
}

}  // namespace

void require_rule(const scenario::Scenario& scenario) {
  const controller::LawFacts& law = controller::law_facts(scenario.controller.law);
  if (law.name == controller::external_law_name)
    controller::scenario_law(scenario);  // throws with the reason
  if (!law.no_linearisation.empty()) {
    throw Failure(ExitCode::check_said_no,
                  "{} cannot be linearised ({}): tune it by hand, or by the rule of thumb of "
                  "tachless sweep --laws",
                  law.name, law.no_linearisation);
  }
  if (scenario.robot.flexible && !law.needs_flexible_joints) {
    throw Failure(ExitCode::check_said_no,
                  "{} is a law for rigid joints and {} has flexible ones: take "
                  "--set controller.law=loria_ortega_flexible, or kelly_flexible to hold a posture",
                  law.name, scenario.robot.name);
  }
}

ReferencePoint rest_in_range(const robot::Model& model, int k) {
  Vector q = numerics::spread_posture(model, k);
  for (int i = 0; i < model.num_joints; ++i) {
    const double width = model.upper[i] - model.lower[i];
    if (model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::revolute &&
        width < 2 * std::numbers::pi) {
      q[i] = model.lower[i] + (q[i] + std::numbers::pi) / (2 * std::numbers::pi) * width;
    }
  }
  return linear::constant_reference(q);
}

double rounded(double value, int digits) {
  const std::string text = fmt::format("{:.{}g}", value, digits);
  // Parses subnormal numbers too.
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

DesignProblem::DesignProblem(const scenario::Scenario& scenario, const DesignGoal& goal,
                             const linear::LawAnswers& answers)
    : scenario_(scenario),
      goal_(goal),
      law_(answers ? controller::law_facts(controller::external_law_name)
                   : tuned_law(scenario.controller.law)),
      model_(linear::plant_of(scenario)),
      mean_(tuning_of(scenario)),
      held_inertia_(mean_.inertia),
      loop_(answers ? scenario : with(by_rule(1, 10)), answers),
      start_(answers ? scenario.controller.gains : Gains()) {
  rests_ = loop_.rest_points(settling_postures);
  for (std::size_t k = 0; k < rests_.size(); ++k) problem_.settling.push_back(k);
  if (loop_.moves()) {
    for (const ReferencePoint& rest : loop_.rest_points(margin_postures)) rests_.push_back(rest);
  }
  std::vector<ReferencePoint> all = rests_;
  for (int k = 1; k <= mean_postures; ++k) all.push_back(rest_in_range(model_, k));
  const robot::Model& links = scenario.robot.flexible ? *scenario.model : model_;
  mean_.inertia = mean_of_inertia(links, all, false);
  held_inertia_ = mean_of_inertia(links, all, true);
  mean_matrix_ = mean_matrix(links, all);
}

scenario::Scenario DesignProblem::with(const Gains& gains) const {
  scenario::Scenario scenario = scenario_;
  scenario.controller.gains = gains;
  return scenario;
}

std::string DesignProblem::name_of(std::size_t variable) const {
  const auto count = static_cast<std::size_t>(per_kind());
  if (!entries_.empty() && entries_[variable] >= 0) {
    return kinds_[variable] + " of " +
           robot::joint_labels(*scenario_.model)
               .joint(static_cast<std::size_t>(entries_[variable]));
  }
  if (!by_joint_) return kinds_[variable];
  return kinds_[variable / count] + " of " +
         robot::joint_labels(*scenario_.model).joint(variable % count);
}

Gains DesignProblem::by_rule(double w, double r, const RuleOptions& options) const {
  Tuning tuning = mean_;
  tuning.inertia.array() *= (held_inertia_.array() / mean_.inertia.array()).pow(options.held);
  tuning.w = w;
  tuning.damping = options.damping;
  tuning.filter = std::min(r * w, rate());
  Gains all = law_.tuned(tuning);
  for (const controller::Parameter& each : law_.parameters) {
    const auto part = all.find(std::string(each.name));
    // An optional part that the rule does not use stays as the scenario has it.
    if (!each.required && part != all.end() && part->second.isZero(0)) all.erase(part);
    const auto given = scenario_.controller.gains.find(std::string(each.name));
    const bool ruled = each.required || all.contains(std::string(each.name));
    if (!ruled && given != scenario_.controller.gains.end()) all.insert(*given);
  }
  const Vector& friction = scenario_.plant.drive.viscous_friction_Nms_per_rad;
  for (const controller::Parameter& each : law_.parameters) {
    if (each.shape != base::Shape::matrix || mean_matrix_.size() == 0) continue;
    if (mean_matrix_.size() > max_joints) continue;  // a gain cannot hold more numbers
    Vector& value = all.at(std::string(each.name));
    Matrix matrix = value[0] / tuning.inertia[0] * mean_matrix_;
    if (each.name == "kp" && friction.size() > 0) matrix.diagonal() += w * friction;
    value = matrix.reshaped();
  }
  const auto kp = all.find("kp");
  if (kp != all.end() && kp->second.size() == friction.size() && kp->second == tuning.kp()) {
    kp->second += w * friction;
  }
  // Only the product kd b counts, in the loop and in its certificate.
  if (options.one_b && all.contains("b") && all.contains("kd") &&
      all["kd"].size() == all["b"].size()) {
    all["kd"] = all["kd"].cwiseProduct(all["b"]) / rate();
    all["b"].setConstant(rate());
  }
  follow(all);
  return all;
}

void DesignProblem::follow(Gains& all) const {
  if (!kinds_.empty() && !has_own_gains_ && all.contains("b")) all["b"] = all["a"];
  if (!law_.tuned || !all.contains("ki")) return;
  Tuning slowest = mean_;
  slowest.w = all["kp"].cwiseQuotient(mean_.inertia).cwiseSqrt().minCoeff();
  slowest.filter = all["a"].minCoeff();
  const Gains rule = law_.tuned(slowest);
  if (!rule.contains("ki")) return;  // the law's integral is optional, and stays as it is given
  all["ki"] = rule.at("ki").cwiseProduct(all["kp"]).cwiseQuotient(rule.at("kp"));
  all["eps_1"] = rule.at("eps_1");
  all["eps_2"].setConstant(rule.at("eps_2")[0] * rule.at("b")[0] / all["b"].minCoeff());
}

Index DesignProblem::per_kind() const { return by_joint_ ? model_.num_joints : 1; }
Gains DesignProblem::gains(const VectorXd& theta) const {
  Gains all = start_;
  for (std::size_t kind = 0; kind < kinds_.size(); ++kind) {
    const auto first = static_cast<Index>(kind) * per_kind();
    if (by_joint_) {
      all[kinds_[kind]] = theta.segment(first, per_kind()).array().exp();
    } else {
      scale(all, kind, std::exp(theta[first]));
    }
  }
  follow(all);
  return all;
}
Gains DesignProblem::rounded(Gains all) const {
  for (auto& [name, values] : all) {
    if (!law_.tuned && values.size() != model_.num_joints) continue;
    for (double& value : values) value = design::rounded(value, 4);
  }
  return all;
}
VectorXd DesignProblem::theta_of(const Gains& gains) const {
  VectorXd theta = VectorXd::Zero(std::ssize(kinds_) * per_kind());
  for (std::size_t kind = 0; kind < kinds_.size(); ++kind) {
    const Vector& own = gains.at(kinds_[kind]);
    const auto first = static_cast<Index>(kind) * per_kind();
    if (by_joint_) {
      theta.segment(first, per_kind()) = own.array().log();
    } else {
      theta[first] = std::log(own[0] / start_.at(kinds_[kind])[0]);
    }
  }
  return theta;
}
std::optional<VectorXd> DesignProblem::own_theta() const {
  // The member start_ holds the scenario's gains.
  if (!entries_.empty()) return VectorXd::Zero(std::ssize(kinds_));
  Gains own = scenario_.controller.gains;
  for (auto& [name, value] : own) {
    const auto like = start_.find(name);
    if (like == start_.end()) return std::nullopt;
    if (value.size() == 1) value = Vector::Constant(like->second.size(), value[0]);
  }
  for (const auto& [name, value] : own) {  // only the product kd b counts
    const auto kd = own.find("kd" + name.substr(1));
    if (is_filter_gain(name) && kd != own.end()) {
      kd->second.array() *= value.array() / start_.at(name).array();
    }
  }
  for (const std::string& kind : kinds_) {
    if (!own.contains(kind)) return std::nullopt;
  }
  return theta_of(own).cwiseMax(problem_.lower).cwiseMin(problem_.upper);
}
std::optional<VectorXd> DesignProblem::softer(const VectorXd& theta) const {
  if (!entries_.empty()) return std::nullopt;
  VectorXd half = theta;
  for (std::size_t kind = 0; kind < kinds_.size(); ++kind) {
    auto own = half.segment(static_cast<Index>(kind) * per_kind(), per_kind()).array();
    if (kinds_[kind].starts_with("kp")) own -= std::log(4);
    if (kinds_[kind].starts_with("kd") || kinds_[kind] == "w") own -= std::log(2);
  }
  return half;
}
void DesignProblem::scale(Gains& gains, std::size_t kind, double factor) const {
  Vector& own = gains.at(kinds_[kind]);
  const bool all = entries_.empty() || entries_[kind] < 0;
  own.segment(all ? 0 : entries_[kind], all ? own.size() : 1) *= factor;
}
linear::LinearLaw DesignProblem::feedback_at(const Gains& gains, const ReferencePoint& rest) const {
  linear::LinearLaw law = loop_.law_with(gains, rest);
  law.D -= law.compensation;
  return law;
}
linear::Feedback DesignProblem::feedback(const VectorXd& theta, const ReferencePoint& rest,
                                         bool derivatives) const {
  const Gains here = gains(theta);
  linear::Feedback feedback{feedback_at(here, rest), {}, by_joint_};
  if (!derivatives) return feedback;
  for (std::size_t kind = 0; kind < kinds_.size(); ++kind) {
    Gains moved = here;
    scale(moved, kind, std::exp(gain_difference));
    feedback.by_kind.push_back(difference(feedback_at(moved, rest), feedback.law));
  }
  return feedback;
}

linear::RestLoop DesignProblem::loop_at(const ReferencePoint& rest, const UncertainPlant* plant,
                                        bool once) const {
  const double h = scenario_.loop.period_s;
  const linear::SampledLoop loop = loop_.at(rest);
  if (plant == nullptr) return {loop.plant, loop.law(h), h, loop.delay, !once};
  return {loop_.plant_with(plant->model, rest), loop.law(h), h, loop.delay + plant->more_delay,
          !once};
}
GainProblem DesignProblem::at(const std::vector<ReferencePoint>& rests) const {
  GainProblem problem = problem_;
  problem.loops = parallel_map(rests.size(), [&](std::size_t i) { return loop_at(rests[i]); });
  problem.rests = rests;
  problem.share.assign(rests.size(), 1);
  problem.feedback = [this](const VectorXd& theta, const ReferencePoint& rest, bool derivatives) {
    return feedback(theta, rest, derivatives);
  };
  return problem;
}

void DesignProblem::choose_variables() {
  problem_.resonant = scenario_.robot.flexible.has_value();
  problem_.margin = goal_.modulus;
  problem_.settling_s = goal_.settling_s.value_or(0);
  if (!law_.tuned) {
    choose_entries();
    set_bounds();
    return;
  }
  start_ = by_rule(10, 10);
  has_own_gains_ = std::ranges::any_of(law_.parameters, [](const controller::Parameter& each) {
    return each.shape == base::Shape::joints;
  });
  const Gains ruled = law_.tuned(mean_);
  for (const controller::Parameter& each : law_.parameters) {
    const bool left = !each.required && !ruled.contains(std::string(each.name));
    const bool redundant = is_filter_gain(each.name) || each.name == "ki" || left;
    const bool varies =
        has_own_gains_ ? each.shape == base::Shape::joints
                       : each.shape == base::Shape::number || each.shape == base::Shape::matrix;
    if (varies && !redundant) kinds_.emplace_back(each.name);
  }
  follow(start_);
  if (kinds_.empty()) {
    throw Failure(ExitCode::check_said_no,
                  "design varies gains, and {} has none: tune it by hand, or take "
                  "loria_ortega_rigid",
                  law_.name);
  }
  const linear::LinearLaw first = feedback_at(start_, rests_.front()),
                          last = feedback_at(start_, rest_in_range(model_, mean_postures));
  const double size = first.D.cwiseAbs().maxCoeff();
  by_joint_ = has_own_gains_ && (first.D - last.D).cwiseAbs().maxCoeff() < 1e-5 * size &&
              (first.B - last.B).isZero(1e-5);  // also true for a law without memory
  problem_.same_everywhere = by_joint_;
  set_bounds();
}

VectorXd DesignProblem::upper_within(double hz) const {
  VectorXd upper = problem_.upper;
  const VectorXd by = theta_of(by_rule(2 * std::numbers::pi * hz, 10));
  upper.head(per_kind()) = upper.head(per_kind()).cwiseMin(by.head(per_kind()));
  return upper;
}

void DesignProblem::set_bounds() {
  const Index n = model_.num_joints, variables = std::ssize(kinds_) * per_kind();
  problem_.upper = VectorXd::Constant(variables, entries_.empty() ? 100 : std::log(most_factor));
  problem_.lower = -problem_.upper;
  const auto& limit = scenario_.plant.drive.torque_limit_Nm;
  const auto& bits = scenario_.plant.encoder.resolution_bits;
  const auto need = [](const auto& goal, const auto& key, const char* what) {
    if (goal && !key) throw Failure(ExitCode::bad_usage, "{}, which the scenario lacks", what);
  };
  need(goal_.start_error, limit, "--start-error needs plant.drive.torque_limit_Nm");
  need(goal_.count_share, limit, "--count-share needs plant.drive.torque_limit_Nm");
  need(goal_.count_share, bits, "--count-share needs plant.encoder.resolution_bits");
  need(goal_.count_Nm, bits, "--noise needs plant.encoder.resolution_bits");
  const Vector count = scenario::encoder_count(scenario_, *scenario_.model);
  problem_.most_gain = VectorXd::Constant(n, infinity);
  for (Index j = 0; j < n; ++j) {
    double torque = goal_.count_Nm.value_or(infinity);
    if (limit) torque = std::min(torque, goal_.count_share.value_or(0.01) * (*limit)[j]);
    if (count[j] > 0) problem_.most_gain[j] = torque / count[j];
  }
  if (!entries_.empty()) return bound_poles();
  design::Gains most = start_;
  for (std::size_t kind = 0; kind < kinds_.size(); ++kind) {
    if (kinds_[kind] == "beta") {  // a torque loop that is much slower or faster is none
      problem_.lower.segment(static_cast<Index>(kind) * per_kind(), per_kind())
          .setConstant(std::log(0.5));
      problem_.upper.segment(static_cast<Index>(kind) * per_kind(), per_kind())
          .setConstant(std::log(3));
    }
    if (kinds_[kind].front() != 'a') continue;
    most.at(kinds_[kind]) = start_.at(kinds_[kind]).cwiseMax(rate());
    const auto first = static_cast<Index>(kind) * per_kind();
    problem_.upper.segment(first, per_kind()) = theta_of(most).segment(first, per_kind());
  }
  if (goal_.bandwidth_hz) problem_.upper = upper_within(*goal_.bandwidth_hz);
  // The goals below need a kp of each joint as the first gain.
  if (!by_joint_ || law_.parameters.front().unit != "N m/rad") {
    if (!goal_.start_error && !goal_.least_kp) return;
    throw Failure(ExitCode::bad_usage,
                  "--stiffness, --rest-error and --start-error are about a kp of each joint "
                  "[N m/rad], and {} has none: take loria_ortega_rigid",
                  law_.name);
  }
  if (goal_.start_error && limit) {
    problem_.upper.head(n) =
        problem_.upper.head(n).cwiseMin(VectorXd((*limit / *goal_.start_error).array().log()));
  }
  if (!goal_.least_kp) return;
  problem_.lower.head(n) = goal_.least_kp->array().log();
  const robot::JointLabels labels = robot::joint_labels(*scenario_.model);
  for (Index j = 0; j < n; ++j) {
    if (problem_.lower[j] <= problem_.upper[j]) continue;
    throw Failure(ExitCode::check_said_no,
                  "--stiffness or --rest-error asks for {:.4g} on {}, where --bandwidth or "
                  "--start-error allows {:.4g}: change one of them",
                  (*goal_.least_kp)[j], labels.joint(static_cast<std::size_t>(j)),
                  std::exp(problem_.upper[j]));
  }
}

Design rule_of_thumb(const scenario::Scenario& scenario, double hz) {
  const DesignProblem law(scenario, {});
  Design design;
  design.gains = law.rounded(law.by_rule(2 * std::numbers::pi * hz, 10, {.one_b = false}));
  return design;
}

}  // namespace tachless::design
