#include "commission/commission.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/failure.h"
#include "commission/findings.h"
#include "commission/hypotheses.h"
#include "identify/least_squares.h"
#include "plant/own_torque.h"
#include "robot/dynamics.h"
#include "scenario/drive_loop.h"

namespace tachless::commission {
namespace {

using base::ExitCode;
using base::Failure;
constexpr double longest_fall_s = 0.03;
constexpr int least_hold = 9;  ///< duration of a trial of gravity's torque [ticks]
constexpr int least_fall = 5;  ///< ticks that must be seen after the longest delay
/// Limit of the protective stop on the following error [rad; m]: above `reach`, so that an arm that
/// does not move is not stopped.
constexpr double following = 0.03;
constexpr double reach = 0.016;  ///< largest deflection of the references [rad; m]
constexpr double joint_s = 3, all_s = 4;
constexpr double longest_unsent_s = 0.02;
/// The sines of a motion: frequency [Hz] and share of the allowed speed.
constexpr std::array<std::pair<double, double>, 3> sines = {{{0.7, 0.18}, {2.9, 0.09}, {7, 0.06}}};

class Procedure : Findings {
 public:
  Procedure(const Scenario& scenario, const Trials& trials, const identify::Report& report)
      : Findings(scenario), trials_(trials), report_(report), arm_(scenario) {}

  Commissioned run() {
    const Fall fall = let_go();
    if ((fall.certain.array() < 0).any()) turn(fall.certain);
    if (fall.moved && !fall.falls) {
      throw Failure(ExitCode::check_said_no,
                    "{}: robot.urdf: the arm moves without torque, but not as gravity pulls at the "
                    "URDF's masses; see base, masses, joint_offsets_rad",
                    scenario_.source);
    }
    sends_gravity_ = fall.falls.value_or(false);
    if (sends_gravity_ && !hold(fall)) return std::move(result_);
    std::vector<Trial> moved;
    for (int joint = 0; joint <= scenario_.num_joints; ++joint) moved.push_back(move(joint));
    std::optional<bool> gravity;
    if (sends_gravity_) gravity = true;
    const ArmHypotheses arm(turned_);
    const Explanation found =
        explain(arm, moved, scenario_.loop.period_s, fall.certain.cwiseAbs(), gravity);
    conclude(fall, found);
    if (found.gravity) withhold(fall, std::move(moved), *found.gravity);
    return std::move(result_);
  }

 private:
  [[nodiscard]] Scenario changed_by(const std::vector<std::string>& overrides) const {
    return scenario::parse_scenario(scenario_.text, scenario_.robot.urdf_text, scenario_.source,
                                    overrides);
  }

  Trial trial(std::vector<std::string> overrides, double duration_s) {
    overrides.insert(overrides.begin(), signs_.begin(), signs_.end());
    if (last_.size() > 0)
      overrides.push_back(fmt::format("plant.initial.position_rad={}", list(last_)));
    const double h = scenario_.loop.period_s;
    overrides.push_back(fmt::format("loop.duration_s={:.12g}", std::round(duration_s / h) * h));
    overrides.push_back(fmt::format("plant.following_error_rad={}", following));
    overrides.push_back(fmt::format("loop.max_missed={}", scenario_.loop.max_missed));
    overrides.emplace_back("plant.initial.torque=hold");
    const Scenario changed = changed_by(overrides);
    Trial result = trials_(changed, overrides);
    result_.seconds += static_cast<double>(result.q.rows()) * h;
    if (result.q.rows() > 0) {
      last_ = result.q.row(result.q.rows() - 1).transpose();
      last_ = last_.cwiseMax(changed.model->lower).cwiseMin(changed.model->upper);
    }
    result_.missed += result.missed;
    result_.arm_is_clock = result.arm_is_clock;
    if (result.q.rows() < changed.loop.num_ticks && result.stopped.empty()) {
      result.stopped = "the run ended early";
    }
    const plant::OwnTorque added(changed);
    const Vector slow = Vector::Zero(changed.num_joints);
    for (Eigen::Index k = 0; added.any() && k < result.q.rows(); ++k) {
      result.tau.row(k) -= added.at(result.q.row(k).transpose(), slow).transpose();
    }
    return result;
  }

  static std::string hold_at(const Vector& q) {
    return fmt::format("reference={{hold: {{position_rad: {}}}}}", list(q));
  }

  /// Returns overrides for the law with these gains. `sends_gravity` sets whether the law sends
  /// gravity's torque.
  static std::vector<std::string> law(const Vector& kp, const Vector& kd, double rate,
                                      bool sends_gravity) {
    return {fmt::format("controller={{law: loria_ortega_rigid, filter: tustin, gains: {{kp: "
                        "{}, kd: {}, a: {}, b: {}}}}}",
                        list(kp), list(kd), rate, rate),
            fmt::format("robot.compensates={{gravity: {}}}", !sends_gravity)};
  }

  /// Runs some milliseconds without torque and judges the fall.
  Fall let_go() {
    const double h = scenario_.loop.period_s;
    double most_s = longest_fall_s;
    Eigen::Index first = 0;
    for (const Vector& signs : arm_.signs()) {
      const Vector most = 0.8 * speed_.cwiseQuotient(arm_.fall(signs).cwiseAbs().cwiseMax(1e-9));
      Eigen::Index joint = 0;
      if (most.minCoeff(&joint) >= most_s) continue;
      most_s = most[joint];
      first = joint;
    }
    const double needed_s = (longest_delay + least_fall) * h;
    if (most_s < needed_s) {
      throw scenario_.complaint(
          "plant.initial.position_rad",
          "gravity alone makes {} faster than a tenth of its limit within {:.2g} ms, {:.2g} are "
          "needed to see what the arm adds; begin nearer to upright or hanging, a few tenths of a "
          "rad from it",
          name(first), 1e3 * most_s, 1e3 * needed_s);
    }
    report_("a moment without torque");
    fall_s_ = std::floor(most_s / h) * h;
    return judge_fall(arm_, still(false, fall_s_), h);
  }

  /// Returns the pole of the soft law [1/s], for a delay of `longest_delay` beyond the loop's own.
  [[nodiscard]] double rate() const {
    return 0.1 /
           (scenario_.loop.period_s * (longest_delay + std::max(1, scenario_.loop.command_delay)));
  }

  /// Runs a trial without feedback torque. Gravity's torque is sent if `sends_gravity` is set.
  Trial still(bool sends_gravity, double duration_s) {
    const Vector none = Vector::Constant(scenario_.num_joints, 1e-9);
    std::vector<std::string> overrides = law(none, none, 1, sends_gravity);
    overrides.push_back(hold_at(turned_.plant.initial.position_rad));
    return trial(overrides, duration_s);
  }

  /// Runs a short trial with gravity's torque.
  /// @return whether the scale of torque fits
  bool hold(const Fall& fall) {
    const double h = scenario_.loop.period_s;
    report_("a moment with gravity's torque");
    const ArmHypotheses arm(turned_);
    const Vector pull = arm.gravity(Vector::Ones(scenario_.num_joints), arm.start());
    double most_s = fall_s_;
    // Torques half as large again, or with the other sign.
    for (const Vector& signs : fall.possible) {
      for (const double scale : {1.5, -1.0}) {
        const Vector a = arm.fall(signs.cwiseProduct(turned_by_), scale * pull).cwiseAbs();
        most_s = std::min(most_s, speed_.cwiseQuotient(a.cwiseMax(1e-9)).minCoeff());
      }
    }
    most_s = std::floor(most_s / h) * h;
    result_.adds_gravity = false;
    if (most_s < least_hold * h) {
      mend_gravity();
      misfit(
          "plant.initial.position_rad",
          fmt::format(
              "the arm falls, and nothing else is determined: within the {:.3g} ms that a trial of "
              "gravity's torque takes, a wrong sign or scale would make a joint too fast; "
              "begin nearer to upright or hanging",
              1e3 * least_hold * h),
          false);
      return false;
    }
    const Vector scale = scale_of_hold(arm, turned_by_.cwiseProduct(fall.acceleration), fall.onset,
                                       still(true, most_s), h);
    const bool told = (fall.certain.array() != 0).all();
    bool fits = true;
    for (Eigen::Index i = 0; i < scale.size(); ++i) {
      const auto j = static_cast<std::size_t>(i);
      Commissioned::Joint joint{name(i), robot::joint_labels(*scenario_.model).effort[j]};
      if (fall.certain[i] != 0) joint.turns = fall.certain[i] < 0;
      if (told && std::isfinite(scale[i])) joint.scale = scale[i];
      fits = fits && !(std::abs(scale[i] - 1) > 0.25);
      result_.joints.push_back(std::move(joint));
    }
    // The error of the sent gravity torque may be as large as the soft law can stop in time.
    const Vector stopped = 0.3 * rate() * std::numbers::e * speed_.cwiseProduct(arm_.inertia());
    for (const Vector& signs : fall.possible) {
      const Vector wrong = arm.gravity(signs.cwiseProduct(turned_by_), arm.start()) - pull;
      fits = fits && (wrong.cwiseAbs().array() <= stopped.array()).all();
    }
    for (Eigen::Index i = 0; i < scale.size(); ++i) {
      fits = fits && !(std::abs((scale[i] - 1) * pull[i]) > stopped[i]);
    }
    if (fits) {
      result_.joints.clear();
      return true;
    }
    mend_gravity();
    if (told) {
      mend_signs({Vector::Ones(scale.size())});
      mend_scales();
    }
    if (result_.mendable) {
      misfit(
          "robot.joint_signs",
          "gravity's torque holds the arm too badly to go on: scale of torque, masses, or signs "
          "that the fall did not determine; look which way each joint turns, or begin at another "
          "posture",
          false);
    }
    return false;
  }

  /// Changes the signs of the scenario for the following trials.
  void turn(const Vector& signs) {
    turned_by_ = signs.unaryExpr([](double s) { return s < 0 ? -1.0 : 1.0; });
    const Vector start = start_with(turned_by_);
    last_ = turned(last_, turned_by_, scenario_.robot.joint_offsets_rad);
    signs_ = {fmt::format("robot.joint_signs={}",
                          list(scenario_.robot.joint_signs.cwiseProduct(turned_by_))),
              fmt::format("plant.initial.position_rad={}", list(start))};
    std::vector<std::string> overrides = signs_;
    overrides.push_back(hold_at(start));
    turned_ = changed_by(overrides);
  }

  /// Runs sines on one joint, or on all joints if `joint` is the number of joints.
  /// @param withheld see plant.withheld_ticks
  Trial move(int joint, int withheld = 0) {
    const bool all = joint == scenario_.num_joints;
    const Vector& start = turned_.plant.initial.position_rad;
    const double h = scenario_.loop.period_s;
    std::vector<std::string> overrides =
        law(rate() * rate() * arm_.inertia(), 2 * rate() * arm_.inertia(),
            std::min(60 * rate(), 1 / h), sends_gravity_);
    Vector offset = start;
    std::string terms;
    for (const auto& [hz, share] : sines) {
      Vector amplitude = Vector::Zero(start.size()), frequency = amplitude;
      for (Eigen::Index i = 0; i < start.size(); ++i) {
        frequency[i] = hz * (all ? 1 + 0.09 * static_cast<double>(i) : 1);
        if (!all && i != joint) continue;
        const double omega = 2 * std::numbers::pi * frequency[i];
        amplitude[i] = std::min(share * speed_[i] / omega, reach / 2 / sines.size());
      }
      offset -= amplitude;  // begins at rest at the start
      terms += fmt::format("{{amplitude_rad: {}, frequency_hz: {}, phase_rad: {:.17g}}}, ",
                           list(amplitude), list(frequency), std::numbers::pi / 2);
    }
    overrides.push_back(fmt::format("reference={{multi_sine: {{offset_rad: {}, terms: [{}]}}}}",
                                    list(offset), terms));
    overrides.push_back(fmt::format("plant.withheld_ticks={}", withheld));
    report_(withheld > 0 ? std::string("all joints, with torques that are not sent")
            : all        ? std::string("all joints")
                         : name(joint));
    Trial result = trial(overrides, all ? all_s : joint_s);
    if (!result.stopped.empty() && withheld == 0) ran_away(result);
    return result;
  }

  /// Determines whether the arm holds the previous torque or takes zero when none is sent. The
  /// better explanation of the motion of all joints decides.
  /// @param moved the trials that have been explained
  void withhold(const Fall& fall, std::vector<Trial> moved, bool gravity) {
    const double h = scenario_.loop.period_s;
    const int ticks = std::max(1, static_cast<int>(std::min(longest_unsent_s, fall_s_ / 2) / h));
    Trial held = move(scenario_.num_joints, ticks);
    if (!held.stopped.empty()) {
      result_.unsent = Unsent::ends_the_run;
      result_.unsent_text = held.stopped;
      return;
    }
    plant::Spec plant;
    plant.withheld_ticks = ticks;
    Trial zeroed = held;
    for (Eigen::Index k = 1; k < held.tau.rows(); ++k) {
      if (!plant::withheld(plant, k)) continue;
      held.tau.row(k) = held.tau.row(k - 1);
      zeroed.tau.row(k).setZero();
    }
    const ArmHypotheses arm(turned_);
    const auto cost = [&](const Trial& trial) {
      moved.back() = trial;
      return explain(arm, moved, h, fall.certain.cwiseAbs(), gravity).cost;
    };
    const double more = cost(zeroed) - cost(held);
    if (std::abs(more) > clear) result_.unsent = more > 0 ? Unsent::held : Unsent::zeroed;
  }

  [[noreturn]] void ran_away(const Trial& trial) const {
    Eigen::Index joint = 0;
    const Eigen::Index last = trial.q.rows() - 1, from = std::max<Eigen::Index>(0, last - 60);
    if (last >= 1) (trial.q.row(last) - trial.q.row(0)).cwiseAbs().maxCoeff(&joint);
    double sum = 0;  // sum of acceleration times torque
    const Eigen::MatrixXd q = identify::low_passed(trial.q, scenario_.loop.period_s);
    for (Eigen::Index k = from + 1; k < last; ++k) {
      sum += (q(k + 1, joint) - 2 * q(k, joint) + q(k - 1, joint)) * trial.tau(k, joint);
    }
    if (sum < 0 && last > 5) {
      throw Failure(
          ExitCode::protective_stop,
          "{}: {} moves against its own torque: the driver's torque has another sign than "
          "its positions; correct the driver (robot.joint_signs turns both)",
          scenario_.source, name(joint));
    }
    throw Failure(ExitCode::protective_stop, "{}: not determined, because {} ran away: {}",
                  scenario_.source, name(joint), trial.stopped);
  }

  void conclude(const Fall& fall, const Explanation& found) {
    const robot::JointLabels labels = robot::joint_labels(*scenario_.model);
    std::vector<double> delays;
    for (Eigen::Index i = 0; i < speed_.size(); ++i) {
      const auto j = static_cast<std::size_t>(i);
      const Explanation::Joint& of = found.joints[j];
      Commissioned::Joint joint{name(i),    labels.effort[j], {}, {},
                                of.viscous, of.dry,           {}, of.noise};
      const bool told = std::ranges::all_of(
          found.signs, [&](const Vector& each) { return each[i] == found.signs.front()[i]; });
      if (told) joint.turns = turned_by_[i] * found.signs.front()[i] < 0;
      if (of.clean && of.scale > 0) {
        joint.scale = of.scale;
        joint.delay = of.delay;
        delays.push_back(of.delay);
      }
      result_.joints.push_back(std::move(joint));
    }
    if (fall.falls.value_or(false)) {
      result_.adds_gravity = false;
    } else if (found.gravity) {
      result_.adds_gravity = !*found.gravity;
    }
    judge_delay(delays, found.delay);
    judge_friction(found);
    mend_signs(found.signs);
    mend_scales();
    mend_gravity();
    mend_delay();
  }

  const Trials& trials_;
  const identify::Report& report_;
  ArmHypotheses arm_;
  Scenario turned_ = scenario_;  ///< with the signs that the fall determined
  std::vector<std::string> signs_;
  bool sends_gravity_ = false;
  double fall_s_ = 0;
  Vector last_;  ///< position of the arm at the end of the last trial
};

}  // namespace

Commissioned commission(const Scenario& scenario, const Trials& trials,
                        const identify::Report& report) {
  scenario::require_no_drive_loop(scenario, "commission measures what the host's torques do");
  return Procedure(scenario, trials, report).run();
}

}  // namespace tachless::commission
