#include "commission/trials.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/failure.h"
#include "commission/hypotheses.h"
#include "plant/own_torque.h"
#include "plant/plant_model.h"

namespace tachless::commission {
namespace {

constexpr int most_repeats = 3;  ///< of a trial
constexpr double look_s = 0.05;
constexpr int most_looks = 40;  ///< an arm that still moves after 2 s does not come to rest
/// Motion between trials that shows an arm without brakes, and motion during a look that is none
/// [rad; m].
constexpr double sagging = 1e-3, resting = 2e-4;

/// Returns the signs of the joints that a hypothesis turns.
std::string signs_override(const scenario::Scenario& scenario, const Vector& signs) {
  return fmt::format("robot.joint_signs={}", list(scenario.robot.joint_signs.cwiseProduct(signs)));
}

}  // namespace

Vector careful_speed(const robot::Model& model) {
  return model.velocity_limit.unaryExpr(
      [](double limit) { return 0.1 * (std::isfinite(limit) ? limit : 1.0); });
}

ArmRuns::ArmRuns(const scenario::Scenario& scenario, const Trials& trials)
    : scenario_(scenario),
      trials_(trials),
      at_(scenario),
      speed_(careful_speed(*scenario.model)),
      count_(scenario::encoder_count(scenario, plant::plant_model(scenario))),
      turned_by_(Vector::Ones(scenario.num_joints)),
      last_(scenario.plant.initial.position_rad) {}

double ArmRuns::rate() const {
  return 0.2 / (period_s() * (longest_delay + std::max(1, scenario_.loop.command_delay)));
}

Vector ArmRuns::began() const {
  return turned(scenario_.plant.initial.position_rad, turned_by_,
                scenario_.robot.joint_offsets_rad);
}

void ArmRuns::turn(const Vector& signs) {
  const Vector change = signs.cwiseProduct(turned_by_), offset = scenario_.robot.joint_offsets_rad;
  last_ = offset + change.cwiseProduct(last_ - offset);
  turned_by_ = signs;
  at_ = scenario::parse_scenario(
      scenario_.text, scenario_.robot.urdf_text, scenario_.source,
      {signs_override(scenario_, signs), "plant.initial.position_rad=" + list(last_),
       fmt::format("reference={{hold: {{position_rad: {}}}}}", list(last_))});
}

Trial ArmRuns::until_done(const std::function<std::optional<Trial>()>& run) {
  for (int times = 1; times <= 1 + most_repeats; ++times) {
    if (auto trial = run()) return std::move(*trial);
    ++repeated;
  }
  throw base::Failure(base::ExitCode::check_said_no,
                      "{}: a run had late or missing ticks {} times: this machine is too busy; "
                      "type: tachless doctor",
                      scenario_.source, 1 + most_repeats);
}

Trial ArmRuns::from_here(const std::function<std::optional<Trial>()>& run) {
  return until_done([&] {
    if (moves_ || sags_) look();
    moves_ = true;  // until the run has told where the arm is
    return run();
  });
}

std::optional<Trial> ArmRuns::carry_out(const std::vector<std::string>& changes) {
  const scenario::Scenario changed = scenario::parse_scenario(
      scenario_.text, scenario_.robot.urdf_text, scenario_.source, changes);
  std::optional<Trial> done = trials_(changed, changes);
  if (!done || done->q.rows() == 0) return done;
  Trial& trial = *done;
  const plant::OwnTorque added(changed);
  const Vector slow = Vector::Zero(changed.num_joints);
  for (Eigen::Index k = 0; added.any() && k < trial.q.rows(); ++k) {
    trial.tau.row(k) -= added.at(trial.q.row(k).transpose(), slow).transpose();
  }
  last_ = trial.q.row(trial.q.rows() - 1).transpose();
  last_ = last_.cwiseMax(scenario_.model->lower).cwiseMin(scenario_.model->upper);
  return done;
}

void ArmRuns::look() {
  const double ticks = std::max(3.0, std::round(look_s / period_s()));
  for (int i = 0; i < most_looks; ++i) {
    const Vector before = last_;
    const Trial seen = until_done([&] {
      return carry_out({signs_override(scenario_, turned_by_), "plant.dry_run=true",
                        fmt::format("loop.duration_s={:.12g}", ticks * period_s()),
                        fmt::format("reference={{hold: {{position_rad: {}}}}}", list(last_)),
                        "loop.max_missed_share=1"});
    });
    if (seen.q.rows() == 0) throw base::bad_usage("no reading of the arm: {}", seen.stopped);
    sags_ = sags_ || (last_ - before).cwiseAbs().maxCoeff() > sagging;
    const Vector moved = (seen.q.bottomRows(1) - seen.q.topRows(1)).cwiseAbs().transpose();
    if ((moved.array() <= (answer_counts * count_).cwiseMax(resting).array()).all()) break;
  }
  moves_ = false;
}

std::optional<Trial> ArmRuns::run(const SoftLaw& law, const std::string& reference,
                                  const Vector& reach, double duration_s,
                                  std::vector<std::string> changes) {
  const double h = period_s(), ticks = std::round(duration_s / h);
  const bool sends = law.gravity_share > 0;
  const double pole = std::min(30 * rate(), 1 / h);
  changes.insert(
      changes.begin(),
      {signs_override(scenario_, turned_by_),
       fmt::format("plant.initial.position_rad={}", list(last_)),
       fmt::format("loop.duration_s={:.12g}", ticks * h),
       fmt::format("plant.following_error_rad={}", list(reach)),
       fmt::format("plant.speed_limit_rad_per_s={}", list(speed_)),
       fmt::format("loop.max_missed={}", scenario_.loop.max_missed),
       fmt::format("loop.max_missed_share={:.6g}",
                   std::min(1.0, std::max({scenario_.loop.max_missed_share, most_missed_share,
                                           3 / ticks}))),
       "plant.initial.torque=hold",
       fmt::format("controller={{law: loria_ortega_rigid, filter: tustin, gains: {{kp: {}, kd: "
                   "{}, a: {}, b: {}}}}}",
                   list(law.kp), list(law.kd), pole, pole),
       fmt::format("robot.compensates={{gravity: {}}}", !sends),
       fmt::format("robot.gravity_m_per_s2={}",
                   scenario_.robot.gravity_m_per_s2 * (sends ? law.gravity_share : 1)),
       "reference=" + reference});
  if (law.rotor.size() > 0) {
    changes.push_back(
        fmt::format("robot.joints={{rigid: {{rotor_inertia_kgm2: {}}}}}", list(law.rotor)));
  }
  std::optional<Trial> done = carry_out(changes);
  if (!done) return done;
  Trial& trial = *done;
  const auto rows = trial.q.rows();
  seconds += static_cast<double>(rows) * h;
  missed += trial.missed;
  arm_is_clock = trial.arm_is_clock;
  // The last ticks may have no reading.
  if (static_cast<double>(rows) < (1 - most_missed_share) * ticks && trial.stopped.empty()) {
    trial.stopped = "the run ended early";
  }
  moves_ = !trial.stopped.empty();
  return done;
}

Trial ArmRuns::still(double gravity_share, const Vector& reach, double duration_s) {
  const Vector none = Vector::Constant(last_.size(), no_gain);
  Trial trial = from_here([&] {
    return run({none, none, gravity_share},
               fmt::format("{{hold: {{position_rad: {}}}}}", list(last_)), reach, duration_s);
  });
  moves_ = true;
  return trial;
}

Trial ArmRuns::sines(const SoftLaw& law, const std::vector<Vector>& amplitude,
                     const std::vector<Vector>& frequency_hz, double duration_s, int withheld) {
  const auto from_last = [&] {
    Vector offset = last_;
    std::string terms;
    // The motion is towards where the arm began.
    const Vector away = (last_ - began()).unaryExpr([](double x) { return x < 0 ? -1.0 : 1.0; });
    for (std::size_t i = 0; i < amplitude.size(); ++i) {
      const Vector signed_amplitude = amplitude[i].cwiseProduct(away);
      offset -= signed_amplitude;
      terms += fmt::format("{{amplitude_rad: {}, frequency_hz: {}, phase_rad: {:.17g}}}, ",
                           list(signed_amplitude), list(frequency_hz[i]), std::numbers::pi / 2);
    }
    return run(law,
               fmt::format("{{multi_sine: {{offset_rad: {}, terms: [{}]}}}}", list(offset), terms),
               Vector::Constant(last_.size(), farthest), duration_s,
               {fmt::format("plant.withheld_ticks={}", withheld)});
  };
  return from_here(from_last);
}

Trial ArmRuns::pulses(const SoftLaw& law, const Pulses& pulses) {
  const auto from_last = [&] {
    constexpr int knots = 8;  // of a pulse: the spline through them hardly overshoots
    std::string times, positions;
    double amplitude = std::ldexp(pulses.largest, 1 - pulses.count);
    if (pulses.count % 2 == 0) amplitude = -amplitude;  // the last one is positive
    for (int k = 0; k <= pulses.count * knots; ++k) {
      const double phase = 2 * std::numbers::pi * (k % knots) / knots;
      Vector q = last_;
      q[pulses.joint] += amplitude / 2 * (1 - std::cos(phase));
      times += fmt::format("{}, ", k * pulse_s / knots);
      positions += list(q) + ", ";
      if (k % knots == knots - 1) amplitude *= -2;
    }
    Vector reach = Vector::Constant(last_.size(), aside);
    reach[pulses.joint] = pulses.reach;
    return run(law,
               fmt::format("{{waypoints: {{time_s: [{}], position_rad: [{}]}}}}", times, positions),
               reach, pulse_s * pulses.count);
  };
  return from_here(from_last);
}

}  // namespace tachless::commission
