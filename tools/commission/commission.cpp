#include "commission/commission.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "base/failure.h"
#include "commission/hypotheses.h"
#include "commission/misfits.h"
#include "commission/trials.h"
#include "scenario/drive_loop.h"

namespace tachless::commission {
namespace {

using base::ExitCode;
using base::Failure;
using scenario::Scenario;

constexpr double fall_s = 0.06;
/// Bounds of the deflection that ends a trial without feedback [counts], [rad; m].
constexpr double least_fall_counts = 25, most_fall = 4e-3;
/// Shares of gravity's torque, and the error of the scale that each tells.
constexpr std::array<std::pair<double, double>, 4> gravity_shares = {
    {{0.01, 10}, {0.1, 1.5}, {0.4, 1}, {1, 0.2}}};
/// Motion in a trial of gravity's whole torque beyond which the soft law would not hold the arm
/// [rad; m].
constexpr double held = 1.8e-3;
constexpr double joint_s = 3, all_s = 4;
constexpr double first_level = 0.01, level_ratio = 3, most_level = 1e4;
constexpr double asked_share = 0.2;  ///< of the torque limit, without gravity
/// Explained share of a motion that is an answer, and the share of work of an answer with friction.
constexpr double answer_share = 0.5, against_share = 0.8, surely_against = 0.95, work_share = 0.5;
/// Least growth of a true answer from one level to the next.
constexpr double growing = 2;
/// Ratio of the answer to the model's beyond which the torque has another scale, if the joint is
/// faster, or the law's gains follow the answer.
constexpr double other_scale = 3, other_inertia = 2.5;
constexpr double longest_unsent_s = 0.02;
/// The sines of a motion: frequency [Hz] and share of the allowed speed.
constexpr std::array<std::pair<double, double>, 3> sines = {{{0.7, 0.18}, {2.9, 0.09}, {7, 0.06}}};
constexpr double ask_speed = 0.3;        ///< share of the allowed speed when the joints are asked
constexpr double frequency_step = 0.09;  ///< between joints that move together, relative

/// Returns the frequencies of joints that move together.
Vector frequencies(double hz, Eigen::Index joints) {
  return hz * (1 + frequency_step *
                       Vector::LinSpaced(joints, 0, static_cast<double>(joints - 1)).array());
}

class Procedure {
 public:
  Procedure(const Scenario& scenario, const Trials& trials, const identify::Report& report)
      : scenario_(scenario), report_(report), runs_(scenario, trials), arm_(scenario) {
    const robot::JointLabels labels = robot::joint_labels(*scenario.model);
    for (std::size_t j = 0; j < labels.effort.size(); ++j) {
      found_.joints.push_back({labels.joint(j), labels.effort[j]});
    }
    answers_.assign(labels.effort.size(), false);
    against_.assign(labels.effort.size(), 0);
    level_ = Vector::Constant(scenario.num_joints, first_level);
    gains_inertia_ = arm_.inertia();
    moved_ = own_ = Vector::Zero(scenario.num_joints);
  }

  Commissioned run() {
    if (hold_still() && ask()) move_and_explain();
    found_.seconds = runs_.seconds;
    found_.missed = runs_.missed;
    found_.repeated = runs_.repeated;
    found_.arm_is_clock = runs_.arm_is_clock;
    return std::move(found_);
  }

 private:
  /// Returns the deflections that end a trial without feedback, so that no joint becomes too fast.
  [[nodiscard]] Vector fall_reach() const {
    Vector reach = Vector::Constant(runs_.speed().size(), most_fall);
    for (const Vector& signs : arm_.signs()) {
      const Vector a = arm_.fall(signs).cwiseAbs().cwiseMax(1e-9);
      const Vector t = (0.8 * runs_.speed().cwiseQuotient(a).array() - 2 * runs_.period_s()).max(0);
      reach = reach.cwiseMin(0.5 * a.cwiseProduct(t.cwiseAbs2()));
    }
    return reach.cwiseMax(least_fall_counts * runs_.count());
  }

  /// Lets the arm go for a moment. If it falls, finds signs and scale of the torque that holds it.
  /// @return whether the arm is held well enough to go on
  bool hold_still() {
    report_("a moment without torque");
    fall_ = judge_fall(arm_, runs_.still(0, fall_reach(), fall_s), runs_.count(), runs_.period_s());
    if (fall_.moved && !fall_.falls) {
      add_misfit(found_, "robot.urdf",
                 "the arm moves without torque, but not as gravity pulls at the URDF's masses; see "
                 "robot.base, plant.payload, rotor inertias, masses, joint_offsets_rad");
      return false;
    }
    if (!fall_.falls.value_or(false)) return true;
    const bool as_stated = std::ranges::any_of(
        fall_.possible, [](const Vector& signs) { return (signs.array() > 0).all(); });
    if (!as_stated) runs_.turn(fall_.signs);
    found_.adds_gravity = false;
    for (const auto& [share, error] : gravity_shares) {
      if (!hold(share, error)) return false;
    }
    return true;
  }

  /// Sends a share of gravity's torque for a moment.
  /// @return whether its scale is right within `error`
  bool hold(double share, double error) {
    report_(fmt::format("a moment with {:.3g} of gravity's torque", share));
    const ArmHypotheses arm(runs_.scenario());
    const Trial trial = runs_.still(share, fall_reach(), fall_s);
    const Vector scale = scale_of_hold(arm, runs_.turned_by().cwiseProduct(fall_.acceleration),
                                       fall_.onset, trial, share, runs_.count(), runs_.period_s());
    const double moved = (trial.q.bottomRows(1) - trial.q.topRows(1)).cwiseAbs().maxCoeff();
    bool fits = share < 1 || (trial.stopped.empty() && moved < held);
    for (Eigen::Index i = 0; share < 1 && i < scale.size(); ++i) {
      fits = fits && !(std::abs(scale[i] - 1) > error);
    }
    if (fits) {
      // These joints answer as they should: the whole soft law may hold them.
      for (Eigen::Index i = 0; share == 1 && i < scale.size(); ++i) {
        if (std::isfinite(scale[i])) level_[i] = 1;
      }
      return true;
    }
    if ((fall_.certain.array() != 0).all()) {
      for (Eigen::Index i = 0; i < scale.size(); ++i) {
        Commissioned::Joint& joint = found_.joints[static_cast<std::size_t>(i)];
        joint.turns = fall_.certain[i] < 0;
        if (std::isfinite(scale[i]) && std::abs(scale[i] - 1) > error) joint.scale = scale[i];
      }
    }
    compare_gravity(scenario_, found_);
    compare_signs(scenario_, fall_.possible, found_);
    compare_scales(scenario_, std::vector<double>(answers_.size(), 0), found_);
    if (found_.mendable) {
      add_misfit(found_, "robot.joint_signs",
                 "gravity's torque holds the arm too badly to go on: scale of torque, masses, or "
                 "signs that the fall did not determine; look which way each joint turns, or begin "
                 "at another posture");
    }
    return false;
  }

  [[nodiscard]] double gravity_share() const { return fall_.falls.value_or(false) ? 1 : 0; }

  /// Returns the soft law for an arm of these inertias of the joints.
  [[nodiscard]] SoftLaw law(const Vector& inertia) const {
    const double rate = runs_.rate();
    return {rate * rate * inertia, 2 * rate * inertia, gravity_share()};
  }

  /// Moves one joint after the other with growing torques, from a hundredth of the soft law's,
  /// until each follows.
  /// @return whether it is safe to go on
  bool ask() {
    const Eigen::Index n = level_.size();
    const Vector amplitude =
        (ask_speed * ArmRuns::bump_s / std::numbers::pi * runs_.speed()).cwiseMin(reach / 2);
    const Vector most = scenario_.plant.drive.torque_limit_Nm.value_or(
        Vector::Constant(n, robot::Model::unlimited));
    for (bool grows = true; grows;) {
      report_(fmt::format("each joint with {:.2g} of the soft law's torque", level_.minCoeff()));
      const Trial trial = runs_.bumps(law(level_.cwiseProduct(arm_.inertia())),
                                      amplitude.cwiseProduct(level_.cwiseMin(1)));
      if (!heard(trial)) return false;
      if (!trial.stopped.empty()) stopped(trial);
      grows = false;
      for (Eigen::Index i = 0; i < n; ++i) {
        const double next = level_ratio * level_[i];
        const double torque = next * runs_.rate() * runs_.rate() * arm_.inertia()[i] * amplitude[i];
        if (moved_[i] >= amplitude[i] / 4 || next > most_level || torque > asked_share * most[i])
          continue;
        level_[i] = next;
        grows = true;
      }
    }
    return all_answered(amplitude);
  }

  /// Reads the answers of the joints to their own torques.
  /// @return whether no joint answers too much or in the wrong direction
  bool heard(const Trial& trial) {
    const auto ticks = static_cast<Eigen::Index>(ArmRuns::bump_s / runs_.period_s());
    const std::vector<double> none(answers_.size(), 0);
    bool safe = true;
    for (std::size_t j = 0; j < answers_.size(); ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      const Answer answer = answer_of(trial, i, i * ticks, ticks, runs_.period_s());
      const double least = answer_counts * runs_.count()[i];
      moved_[i] = answer.moved;
      const bool follows = answer.explained > answer_share && answer.own > least;
      const bool rubs = std::abs(answer.work) > work_share && answer.moved > least;
      if (!follows && !rubs) continue;
      const double ratio = answer.response * arm_.inertia()[i];
      // A drift may look like an answer, but it does not grow with the torque.
      const bool against = follows ? ratio < 0 && answer.explained > against_share
                                   : answer.work < -work_share && answer.explained < answer_share;
      const bool grows = answer.own > growing * own_[i];
      against_[j] = !against ? 0 : against_[j] == 0 ? 1 : against_[j] + (grows ? 1 : 0);
      own_[i] = answer.own;
      answers_[j] = answers_[j] || !against;
      if (against_[j] > 1) found_.joints[j].scale = -1;
      if (follows && ratio > other_scale) found_.joints[j].scale = ratio;
      safe = safe && !found_.joints[j].scale;
      if (!follows || ratio < 0) continue;
      const bool as_stated = ratio < other_inertia && ratio * other_inertia > 1;
      gains_inertia_[i] = as_stated ? arm_.inertia()[i] : 1 / answer.response;
    }
    if (safe && !trial.stopped.empty() && gravity_share() == 0) safe = !find_against(trial);
    if (!safe) compare_scales(scenario_, none, found_);
    return safe;
  }

  /// Looks for the joint whose feedback made it run away.
  bool find_against(const Trial& trial) {
    const auto ticks =
        std::min(trial.q.rows(), static_cast<Eigen::Index>(ArmRuns::bump_s / runs_.period_s()));
    double most = surely_against;
    Commissioned::Joint* joint = nullptr;
    for (std::size_t j = 0; j < answers_.size(); ++j) {
      const Answer answer = answer_of(trial, static_cast<Eigen::Index>(j), trial.q.rows() - ticks,
                                      ticks, runs_.period_s());
      if (answer.response >= 0 || answer.own < held || answer.explained < most) continue;
      most = answer.explained;
      joint = &found_.joints[j];
    }
    if (joint != nullptr) joint->scale = -1;
    return joint != nullptr;
  }

  /// @return whether any joint answers
  bool all_answered(const Vector& amplitude) {
    bool any = false;
    for (std::size_t j = 0; j < answers_.size(); ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      answers_[j] = answers_[j] || moved_[i] > answer_counts * runs_.count()[i];
      any = any || answers_[j];
      found_.joints[j].answers = answers_[j];
      if (answers_[j]) continue;
      const double rate = runs_.rate();
      add_misfit(found_, "no answer",
                 fmt::format("{} moves less than {:g} counts of its encoder under {:.2g} {}; "
                             "released brake? a drive that takes torques? friction above that? its "
                             "torque's unit?",
                             found_.joints[j].name, answer_counts,
                             level_[i] * rate * rate * arm_.inertia()[i] * amplitude[i],
                             found_.joints[j].unit));
    }
    return any;
  }

  /// Ends the commissioning because a trial was stopped.
  [[noreturn]] void stopped(const Trial& trial) const {
    for (std::size_t j = 0; j < answers_.size(); ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      const double hz = oscillation_hz(trial, i, runs_.count()[i], runs_.period_s());
      if (hz == 0) continue;
      throw Failure(ExitCode::protective_stop,
                    "{}: robot.joints: {} oscillates at {:.2g} Hz under a soft law: a flexible "
                    "joint? commission is for rigid joints: {}",
                    scenario_.source, found_.joints[j].name, hz, trial.stopped);
    }
    throw Failure(ExitCode::protective_stop, "{}: not determined, because a joint ran away: {}",
                  scenario_.source, trial.stopped);
  }

  /// Runs sines on one joint, or on all joints if `joint` is the number of joints.
  /// @param withheld see plant.withheld_ticks
  Trial move(Eigen::Index joint, int withheld = 0) {
    const Eigen::Index n = level_.size();
    const bool all = joint == n;
    std::vector<Vector> amplitudes, hertz;
    for (const auto& [hz, share] : sines) {
      const Vector frequency = all ? frequencies(hz, n) : Vector::Constant(n, hz);
      Vector amplitude = (share * runs_.speed().cwiseQuotient(2 * std::numbers::pi * frequency))
                             .cwiseMin(reach / 2 / static_cast<double>(sines.size()));
      for (Eigen::Index i = 0; i < n; ++i) {
        if ((!all && i != joint) || !answers_[static_cast<std::size_t>(i)]) amplitude[i] = 0;
      }
      amplitudes.push_back(std::move(amplitude));
      hertz.push_back(frequency);
    }
    report_(withheld > 0 ? std::string("all joints, with torques that are not sent")
            : all        ? std::string("all joints")
                         : found_.joints[static_cast<std::size_t>(joint)].name);
    Trial result =
        runs_.sines(law(gains_inertia_), amplitudes, hertz, all ? all_s : joint_s, withheld);
    if (!result.stopped.empty() && withheld == 0) stopped(result);
    return result;
  }

  void move_and_explain() {
    const Eigen::Index n = level_.size();
    std::vector<Trial> moved;
    for (Eigen::Index joint = 0; joint <= n; ++joint) moved.push_back(move(joint));
    const ArmHypotheses arm(runs_.scenario());
    std::optional<bool> gravity;
    if (fall_.falls.value_or(false)) gravity = true;
    const Explanation best =
        explain(arm, moved, runs_.period_s(), answers_, fall_.certain.cwiseAbs(), gravity);
    conclude(best);
    if (best.gravity) withhold(arm, std::move(moved), *best.gravity);
  }

  void conclude(const Explanation& best) {
    std::vector<double> heavier;
    bool clean = true;
    std::vector<Vector> possible;
    for (const Vector& each : best.signs) possible.push_back(runs_.turned_by().cwiseProduct(each));
    for (std::size_t j = 0; j < answers_.size(); ++j) {
      const Explanation::Joint& of = best.joints[j];
      heavier.push_back(of.clean ? of.heavier : 0);
      clean = clean && (of.clean || !answers_[j]);
      if (!answers_[j]) continue;
      Commissioned::Joint& joint = found_.joints[j];
      joint.viscous = of.viscous;
      joint.dry = of.dry;
      joint.noise = of.noise;
      const auto i = static_cast<Eigen::Index>(j);
      const bool told = std::ranges::all_of(
          possible, [&](const Vector& each) { return each[i] == possible.front()[i]; });
      if (told) joint.turns = possible.front()[i] < 0;
      if (!of.clean || of.scale <= 0) continue;
      joint.scale = of.scale;
      joint.delay = of.delay;
    }
    if (!fall_.falls.value_or(false) && best.gravity) found_.adds_gravity = !*best.gravity;
    judge_delay(scenario_, best.delay, found_);
    judge_friction(scenario_, runs_.speed(), best, found_);
    compare_signs(scenario_, possible, found_);
    compare_scales(scenario_, heavier, found_);
    compare_gravity(scenario_, found_);
    compare_delay(scenario_, found_);
  }

  /// Determines whether the arm holds the previous torque or takes zero when none is sent. The
  /// better explanation of the motion of all joints decides.
  /// @param moved the trials that have been explained
  void withhold(const ArmHypotheses& arm, std::vector<Trial> moved, bool gravity) {
    const double h = runs_.period_s();
    const double fastest =
        arm_.fall(Vector::Ones(level_.size())).cwiseAbs().cwiseQuotient(runs_.speed()).maxCoeff();
    const int ticks = std::max(
        1, static_cast<int>(std::min(longest_unsent_s, 0.4 / std::max(1e-9, fastest)) / h));
    Trial kept = move(level_.size(), ticks);
    if (!kept.stopped.empty()) {
      found_.unsent = Unsent::ends_the_run;
      found_.unsent_text = kept.stopped;
      return;
    }
    plant::Spec plant;
    plant.withheld_ticks = ticks;
    Trial zeroed = kept;
    for (Eigen::Index k = 1; k < kept.tau.rows(); ++k) {
      if (!plant::withheld(plant, k)) continue;
      kept.tau.row(k) = kept.tau.row(k - 1);
      zeroed.tau.row(k).setZero();
    }
    const auto cost = [&](const Trial& trial) {
      moved.back() = trial;
      return explain(arm, moved, h, answers_, fall_.certain.cwiseAbs(), gravity).cost;
    };
    const double more = cost(zeroed) - cost(kept);
    if (std::abs(more) > clear) found_.unsent = more > 0 ? Unsent::held : Unsent::zeroed;
  }

  const Scenario& scenario_;
  const identify::Report& report_;
  ArmRuns runs_;
  ArmHypotheses arm_;  ///< with the scenario's signs
  Fall fall_;
  std::vector<bool> answers_;  ///< joints that answer their torque
  std::vector<int> against_;   ///< how often in a row each one answered against it
  Vector level_;               ///< last share of the soft law's torque, of each joint
  Vector moved_, own_;         ///< last answer of each joint, its own part [rad; m]
  Vector gains_inertia_;       ///< inertia that a joint's gains are for [kg m^2; kg]
  Commissioned found_;
};

}  // namespace

Commissioned commission(const Scenario& scenario, const Trials& trials,
                        const identify::Report& report) {
  scenario::require_no_drive_loop(scenario, "commission measures what the host's torques do");
  return Procedure(scenario, trials, report).run();
}

}  // namespace tachless::commission
