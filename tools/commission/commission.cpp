#include "commission/commission.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "base/failure.h"
#include "commission/hypotheses.h"
#include "commission/misfits.h"
#include "commission/trials.h"
#include "robot/typical_rotors.h"
#include "scenario/drive_loop.h"

namespace tachless::commission {
namespace {

using base::ExitCode;
using base::Failure;
using scenario::Scenario;

/// Longest time without torque [s]: 18 mm of free fall. `fall_reach` ends the trial of most arms
/// before.
constexpr double fall_s = 0.06;
/// Readings of a fall with which the form of the fall is compared. A drive may take its first
/// torque two ticks late, and a fall of a few readings is then as if gravity were wrong.
constexpr Eigen::Index least_readings = 8;
/// Bounds of the deflection that ends a trial without feedback [counts], [rad; m]. A coarse encoder
/// sees fewer counts: four falls leave room for the pulses.
constexpr double least_fall_counts = 40, most_fall = 5e-4, most_coarse_fall = 2.5e-3;
constexpr double least_pulse_counts = 25;
/// A share of gravity's torque, and bounds of the motion over that of the fall. Without friction a
/// right torque leaves 1 - share; friction leaves less. The bounds exclude a scale above 10, above
/// 8 and above 3, and a wrong sign from a tenth on.
struct GravityShare {
  double share, least, most;
};
constexpr std::array<GravityShare, 4> gravity_shares = {
    {{0.01, 0.9, 1.05}, {0.1, 0.2, 1}, {0.4, -0.2, 0.8}, {1, -1, 1}}};
constexpr double share_counts = 3;       ///< error of a motion [counts]
constexpr double hold_error = 0.2;       ///< of the scale with gravity's whole torque
constexpr double surely_against = -0.4;  ///< scale that no error of a share explains
constexpr double gross_scale = 30;       ///< cogging does not explain it
constexpr std::size_t most_tried = 8;    ///< signs that are tried for an arm that fell
/// Motion in a trial of gravity's whole torque beyond which the soft law would not hold the arm
/// [rad; m].
constexpr double held = 1.8e-3;
/// Lengths of a motion of one joint and of all joints [s]: two and nearly three periods of the
/// slowest sine.
constexpr double joint_s = 3, all_s = 4;
/// Longest time for which no torque is sent [s]. An arm that falls freely moves 2 mm in it.
constexpr double longest_unsent_s = 0.02;

/// The largest motion [rad; m] and share of the allowed speed of a pulse that the URDF's inertia
/// answers without friction. Pulses begin with `first_pulse` of its torque and end with
/// `asked_share` of the torque limit, or `most_pulse` times that torque where there is no limit.
constexpr double pulse_motion = 3e-4, pulse_speed = 0.3;
constexpr double first_pulse = 1e-3, asked_share = 0.2, most_pulse = 100;
constexpr double looked_at = 2.2;  ///< pulses at the end of a trial that tell the answer
/// Trials of a joint's pulses, and trials with an unclear answer, before the joint is given up.
constexpr int most_tries = 24, most_unclear = 4;
/// Distances from where the first pulse began, beyond which a joint, and any joint, is not asked
/// [rad; m].
constexpr double most_strayed = 0.01, most_sagged = 0.024;
constexpr double same_answer = 1.6;  ///< ratio of two answers that are the same
/// Explained share of a motion that is an answer, and the share of the work that has its sign.
constexpr double answer_share = 0.5, work_share = 0.5;
/// Ratio of the answer to the model's beyond which the torque has another scale, and the share of
/// the motion that an unexpected answer has to explain, with friction or with a drift beside it.
constexpr double other_scale = 3, slides_share = 0.98, against_share = 0.85;

/// The sines of a motion: frequency [Hz] and share of the allowed speed.
constexpr std::array<std::pair<double, double>, 3> sines = {{{0.7, 0.18}, {2.9, 0.09}, {7, 0.06}}};
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
    rotor_ = Vector::Zero(scenario.num_joints);
    faster_ = Vector::Ones(scenario.num_joints);
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
    return reach.cwiseMax((least_fall_counts * runs_.count()).cwiseMin(most_coarse_fall));
  }

  /// Lets the arm go for a moment. If it falls, finds signs and scale of the torque that holds it.
  /// @return whether the arm is held well enough to go on
  bool hold_still() {
    report_("a moment without torque");
    free_ = runs_.still(0, fall_reach(), fall_s);
    fall_ = judge_fall(arm_, free_, runs_.count(), runs_.period_s());
    if (fall_.springs) {
      add_misfit(found_, "robot.joints",
                 "without torque the joints accelerate slowly at first, as links on a spring; "
                 "commission is for rigid joints");
      return false;
    }
    if (fall_.moved && !fall_.falls && free_.q.rows() < least_readings) {
      add_misfit(
          found_, "loop.period_s",
          fmt::format("the arm moves without torque, and {} readings do not say how; allowed: "
                      "a loop with at least {} readings before a joint is at a tenth of its "
                      "speed limit",
                      free_.q.rows(), least_readings));
      return false;
    }
    if (fall_.moved && !fall_.falls) {
      name_unknown_fall();
      return false;
    }
    if (!fall_.falls.value_or(false)) return true;
    found_.adds_gravity = false;
    // The signs that the scenario states first: they need no turning.
    std::stable_partition(fall_.possible.begin(), fall_.possible.end(),
                          [](const Vector& signs) { return (signs.array() > 0).all(); });
    for (std::size_t k = 0; k < std::min(most_tried, fall_.possible.size()); ++k) {
      runs_.turn(fall_.possible[k]);
      if (std::ranges::all_of(gravity_shares, [&](const auto& each) { return hold(each); })) {
        return true;
      }
      scales_.push_back(scale_);
    }
    name_what_does_not_hold();
    return false;
  }

  void name_unknown_fall() {
    const Vector as_stated = Vector::Ones(rotor_.size()), none = Vector::Zero(rotor_.size());
    const Vector pull = arm_.gravity(as_stated, arm_.start()).cwiseAbs();
    const Vector seen = arm_.inertial(as_stated, arm_.start(), none, fall_.acceleration);
    Eigen::Index most = 0;
    pull.maxCoeff(&most);
    const Commissioned::Joint& joint = found_.joints[static_cast<std::size_t>(most)];
    add_misfit(
        found_, "robot.urdf",
        fmt::format("without torque the arm moves, and gravity at the URDF's masses does "
                    "not explain how: {} moves as by about {:.2g} {}, gravity is {:.2g} {}; "
                    "see robot.base, plant.payload, rotor inertias, flexible joints, masses, "
                    "joint_offsets_rad, cogging, brakes",
                    joint.name, std::abs(seen[most]), joint.unit, pull[most], joint.unit));
  }

  /// Returns true if each joint moves as in the fall, as far as a share of gravity's torque lets
  /// it.
  [[nodiscard]] bool as_expected(const Trial& trial, const GravityShare& expected) const {
    const Eigen::Index end = std::min(trial.q.rows(), free_.q.rows()) - 1;
    for (Eigen::Index i = 0; i < trial.q.cols(); ++i) {
      const double fell = runs_.turned_by()[i] * (free_.q(end, i) - free_.q(0, i)),
                   moved = trial.q(end, i) - trial.q(0, i);
      const double along = fell < 0 ? -moved : moved, error = share_counts * runs_.count()[i];
      if (along > expected.most * std::abs(fell) + error ||
          along < expected.least * std::abs(fell) - error)
        return false;
    }
    return true;
  }

  /// Sends a share of gravity's torque for a moment.
  /// @return whether its signs and scale are right enough to go on
  bool hold(const GravityShare& applied) {
    report_(fmt::format("a moment with {:.3g} of gravity's torque", applied.share));
    const ArmHypotheses arm(runs_.scenario());
    const Trial trial = runs_.still(applied.share, fall_reach(), fall_s);
    scale_ = scale_of_hold(arm, runs_.turned_by().cwiseProduct(fall_.acceleration), fall_.onset,
                           trial, applied.share, runs_.count(), runs_.period_s());
    const double moved = (trial.q.bottomRows(1) - trial.q.topRows(1)).cwiseAbs().maxCoeff();
    bool fits =
        applied.share < 1 ? as_expected(trial, applied) : trial.stopped.empty() && moved < held;
    for (std::size_t j = 0; fits && applied.share == 1 && j < answers_.size(); ++j) {
      // These joints answer as they should: the soft law may hold them.
      const double error = std::abs(scale_[static_cast<Eigen::Index>(j)] - 1);
      if (error < hold_error) found_.joints[j].answers = answers_[j] = true;
    }
    return fits;
  }

  /// Concludes what the last trial with a share of gravity's torque shows.
  void name_what_does_not_hold() {
    const auto all = [&](Eigen::Index i, const auto& is) {
      bool any = false;
      for (const Vector& scale : scales_) {
        if (std::isnan(scale[i])) continue;
        any = true;
        if (!is(scale[i])) return false;
      }
      return any;
    };
    for (std::size_t j = 0; j < found_.joints.size(); ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      Commissioned::Joint& joint = found_.joints[j];
      if (fall_.certain[i] != 0) joint.turns = fall_.certain[i] < 0;
      if (all(i, [](double scale) { return std::abs(scale) > gross_scale; })) {
        for (const Vector& scale : scales_) {
          if (std::isfinite(scale[i])) joint.scale = std::abs(scale[i]);
        }
      } else if (fall_.certain[i] != 0 &&
                 all(i, [](double scale) { return scale < surely_against; })) {
        joint.scale = -1;
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
  }

  [[nodiscard]] double gravity_share() const { return fall_.falls.value_or(false) ? 1 : 0; }

  /// Returns the soft law, which holds the joints that answer.
  [[nodiscard]] SoftLaw law() const {
    const double rate = runs_.rate();
    SoftLaw law{Vector::Constant(rotor_.size(), ArmRuns::no_gain), {}, gravity_share(), rotor_};
    const Vector inertia = arm_.below_mass_matrix(rotor_).cwiseQuotient(faster_);
    for (std::size_t j = 0; j < answers_.size(); ++j) {
      const auto i = static_cast<Eigen::Index>(j);
      if (answers_[j]) law.kp[i] = rate * rate * inertia[i];
    }
    law.kd = 2 / rate * law.kp;
    if (scenario_.robot.rigid_rotor_inertia_kgm2.size() > 0) {
      law.rotor += scenario_.robot.rigid_rotor_inertia_kgm2;
    }
    return law;
  }

  /// Asks one joint after the other whether and how it answers its own torque, the joints that
  /// gravity accelerates most first.
  /// @return whether it is safe to go on
  bool ask() {
    const Vector pull =
        arm_.gravity(Vector::Ones(rotor_.size()), arm_.start()).cwiseQuotient(arm_.inertia());
    std::vector<Eigen::Index> order(answers_.size());
    std::iota(order.begin(), order.end(), 0);
    std::ranges::sort(order, {}, [&](Eigen::Index i) { return -std::abs(pull[i]); });
    bool safe = true;
    asked_from_ = runs_.position();
    for (const Eigen::Index i : order) {
      const auto j = static_cast<std::size_t>(i);
      if (!answers_[j]) ask(i);
      if (springs_) return false;
      safe = safe && !found_.joints[j].scale && found_.joints[j].answers;
    }
    compare_scales(scenario_, std::vector<double>(answers_.size(), 0), found_);
    return safe && std::ranges::any_of(answers_, [](bool answers) { return answers; });
  }

  /// Sends pulses of growing torque to a joint that nothing else holds, until it moves.
  void ask(Eigen::Index i) {
    Commissioned::Joint& joint = found_.joints[static_cast<std::size_t>(i)];
    const double bend = 2 * std::pow(std::numbers::pi / ArmRuns::pulse_s, 2);
    const double seen = std::min(farthest, least_pulse_counts * runs_.count()[i]);
    const double motion =
        std::min(std::max(pulse_motion, seen),
                 pulse_speed * ArmRuns::pulse_s / std::numbers::pi * runs_.speed()[i]);
    const double nominal = arm_.least_inertia()[i] * motion * bend;
    const auto& limit = scenario_.plant.drive.torque_limit_Nm;
    const double most =
        limit && std::isfinite((*limit)[i]) ? asked_share * (*limit)[i] : most_pulse * nominal;
    SoftLaw law = this->law();
    if (gravity_share() == 0) law.kp.setConstant(ArmRuns::no_gain);  // nothing falls
    law.kd = 2 / runs_.rate() * law.kp;
    law.rotor[i] = most / (motion * bend);
    Pulses pulses{i, motion, static_cast<int>(std::ceil(std::log2(most / nominal / first_pulse))),
                  1.2 * std::max(motion, seen)};
    pulses.count = std::max(pulses.count, 1);
    if (!may_ask(i)) {
      add_misfit(found_, "not asked",
                 fmt::format("{} has not been asked for its answer: without brakes the arm has "
                             "moved {:.2g} since the first pulse; bring it back to where the "
                             "scenario begins, and type commission again",
                             joint.name, (runs_.position() - asked_from_).cwiseAbs().maxCoeff()));
      return;
    }
    double unexpected = 0;
    for (int tries = 0, unclear = 0; tries < most_tries && unclear < most_unclear && may_ask(i);
         ++tries) {
      report_(fmt::format("{}: pulses up to {:.3g} {}", joint.name, most, joint.unit));
      const Trial trial = runs_.pulses(law, pulses);
      const double ticks = ArmRuns::pulse_s / runs_.period_s();
      const Answer answer = answer_of(trial, i, static_cast<Eigen::Index>(looked_at * ticks),
                                      runs_.count()[i], runs_.period_s());
      // Joints that the soft law holds swing too.
      if (gravity_share() == 0 && answer.spring_hz > 0 &&
          answer.moved > answer_counts * runs_.count()[i]) {
        springs_ = true;
        return name_spring(joint, answer.spring_hz);
      }
      const double ratio = response_of(answer) * arm_.least_inertia()[i];
      const bool faster = is_faster(answer, ratio, runs_.count()[i]);
      const bool against = is_against(answer, runs_.count()[i]);
      if (!faster && sign_of(answer, runs_.count()[i]) > 0) return answered(i, answer);
      // An answer that the model does not expect has to be the same for twice the torque. A drift
      // looks like half of it then.
      if (faster || against) {
        const double now = response_of(answer), before = std::exchange(unexpected, now);
        if (before * now > 0 && now / before < same_answer && before / now < same_answer) {
          joint.scale = against ? -1 : ratio;
          joint.answers = true;
          return;
        }
      }
      if (trial.stopped.empty()) {
        if (answer.moved < answer_counts * runs_.count()[i]) joint.answers = false;
        break;
      }
      // If something else moved the joint, go on with the pulses that were not seen.
      const int whole = static_cast<int>(static_cast<double>(trial.q.rows()) / ticks);
      const bool is_seen = answer.explained > answer_share;
      if (is_seen) ++unclear;
      const int next = unexpected != 0 ? 1 : std::max(whole - 1, is_seen ? std::min(whole, 1) : 1);
      pulses.count = std::max(1, pulses.count - next);
    }
    add_misfit(found_, "no answer",
               joint.answers ? fmt::format("{} moves less than {:g} counts of its encoder under "
                                           "{:.2g} {}; released brake? a drive that takes torques? "
                                           "friction above that? its torque's unit?",
                                           joint.name, answer_counts, most, joint.unit)
                             : fmt::format("{} moves, but not by its torque; see what else moves "
                                           "it: gravity, another joint, a drive that holds it, "
                                           "coarse steps of its torque",
                                           joint.name));
  }

  /// Returns whether the arm is near enough to where the first pulse began.
  [[nodiscard]] bool may_ask(Eigen::Index i) const {
    const Vector strayed = (runs_.position() - asked_from_).cwiseAbs();
    return strayed[i] < most_strayed && strayed.maxCoeff() < most_sagged;
  }

  void name_spring(const Commissioned::Joint& joint, double hz) {
    add_misfit(found_, "robot.joints",
               fmt::format("{} moves as on a spring of {:.2g} Hz; commission is for rigid joints",
                           joint.name, hz));
  }

  /// Returns the response that explains a motion from rest if friction is taken into account.
  static double response_of(const Answer& answer) {
    return answer.slides > slides_share ? answer.sliding : answer.response;
  }
  static bool is_faster(const Answer& answer, double ratio, double count) {
    return ratio > other_scale && answer.slides > slides_share && answer.work > 0 &&
           answer.moved > answer_counts * count;
  }
  static bool is_against(const Answer& answer, double count) {
    const bool rubs = answer.work < -work_share && answer.fits > against_share &&
                      answer.explained > against_share;
    // A drift is explained by a constant torque. The pulses have to be seen beside it.
    const bool slides =
        answer.slides > slides_share && answer.sliding < 0 && answer.own > share_counts * count;
    return answer.work < 0 && answer.moved > answer_counts * count &&
           (slides || (rubs && answer.response < 0));
  }

  /// Returns the sign of an answer, 0: not determined.
  static int sign_of(const Answer& answer, double count) {
    const double least = answer_counts * count;
    int by_motion = 0, by_work = 0;
    if (answer.explained > answer_share && answer.own > least)
      by_motion = answer.response > 0 ? 1 : -1;
    if (std::abs(answer.work) > work_share && answer.moved > least)
      by_work = answer.work > 0 ? 1 : -1;
    if (by_motion * by_work < 0) return 0;
    return by_motion != 0 ? by_motion : by_work;
  }

  /// Takes the answer of a joint to its torque.
  void answered(Eigen::Index i, const Answer& answer) {
    const auto j = static_cast<std::size_t>(i);
    Commissioned::Joint& joint = found_.joints[j];
    joint.answers = answers_[j] = true;
    const bool seen = answer.explained > answer_share;
    if (seen) faster_[i] = std::max(1.0, answer.response * arm_.inertia()[i]);
    // The model's inertia is the guess if friction hides the response.
    if (!seen && answer.slides <= slides_share) return;
    const double heavier = 1 / response_of(answer) - arm_.inertia()[i];
    const auto& stated = scenario_.robot.rigid_rotor_inertia_kgm2;
    if ((stated.size() > 0 && stated[i] > 0) || !std::isfinite(scenario_.model->effort_limit[i]))
      return;
    rotor_[i] = std::clamp(heavier, 0.0,
                           robot::rotor_inertia_per_torque * scenario_.model->effort_limit[i]);
  }

  /// Ends the commissioning because a trial was stopped.
  [[noreturn]] void stopped(const Trial& trial) const {
    throw Failure(ExitCode::protective_stop, "{}: not determined, because a joint ran away: {}",
                  scenario_.source, trial.stopped);
  }

  /// Runs sines on one joint, or on all joints if `joint` is the number of joints.
  /// @param withheld see plant.withheld_ticks
  Trial move(Eigen::Index joint, int withheld = 0) {
    const Eigen::Index n = rotor_.size();
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
    Trial result = runs_.sines(law(), amplitudes, hertz, all ? all_s : joint_s, withheld);
    if (!result.stopped.empty() && withheld == 0) stopped(result);
    return result;
  }

  void move_and_explain() {
    const Eigen::Index n = rotor_.size();
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
      const Explanation::Joint& explained = best.joints[j];
      heavier.push_back(explained.clean ? explained.heavier : 0);
      clean = clean && (explained.clean || !answers_[j]);
      if (!answers_[j]) continue;
      Commissioned::Joint& joint = found_.joints[j];
      joint.viscous = explained.viscous;
      joint.dry = explained.dry;
      joint.noise = explained.noise;
      joint.assumed_rotor = rotor_[static_cast<Eigen::Index>(j)];
      const auto i = static_cast<Eigen::Index>(j);
      const bool told = std::ranges::all_of(
          possible, [&](const Vector& each) { return each[i] == possible.front()[i]; });
      if (told) joint.turns = possible.front()[i] < 0;
      if (!explained.clean || explained.scale <= 0) continue;
      joint.scale = explained.scale;
      joint.delay = explained.delay;
    }
    if (!fall_.falls.value_or(false) && best.gravity) found_.adds_gravity = !*best.gravity;
    // A load that only the maker does not know may fall as the whole arm would.
    const bool told = std::ranges::any_of(
        found_.joints, [](const Commissioned::Joint& each) { return each.scale.has_value(); });
    if (!told) found_.adds_gravity.reset();
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
        arm_.fall(Vector::Ones(rotor_.size())).cwiseAbs().cwiseQuotient(runs_.speed()).maxCoeff();
    const int ticks = std::max(
        1, static_cast<int>(std::min(longest_unsent_s, 0.4 / std::max(1e-9, fastest)) / h));
    Trial kept = move(rotor_.size(), ticks);
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
  Trial free_;         ///< the moment without torque
  Fall fall_;
  Vector asked_from_;           ///< position before the first pulse
  Vector scale_;                ///< of the torque, by the last share of gravity's; NaN: not seen
  std::vector<Vector> scales_;  ///< the same for signs that did not hold the arm
  bool springs_ = false;        ///< a joint's pulses show a spring
  std::vector<bool> answers_;   ///< joints that answer their torque
  Vector rotor_;   ///< assumed beyond the scenario's, where it states none [kg m^2; kg]
  Vector faster_;  ///< response of each joint over the model's, at least 1
  Commissioned found_;
};

}  // namespace

Commissioned commission(const Scenario& scenario, const Trials& trials,
                        const identify::Report& report) {
  scenario::require_no_drive_loop(scenario, "commission measures what the host's torques do");
  return Procedure(scenario, trials, report).run();
}

}  // namespace tachless::commission
