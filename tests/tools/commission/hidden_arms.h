#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>
#include <cmath>
#include <deque>
#include <numbers>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "commission/emulated_arm.h"
#include "commission/trials.h"
#include "robot/dynamics.h"

/// Emulated arms with conventions and faults that the commissioned scenario does not state.
namespace tachless::commission {

/// Properties of an arm's drives that no scenario states.
struct DriveFaults {
  Vector scale;          ///< acting torque over sent torque
  int torque_delay = 0;  ///< until a sent torque acts [ticks]
  bool zeroes = false;   ///< zero torque without a command; otherwise the last one is held
  bool is_clock = false;
  bool braked = false;    ///< all brakes stay closed, or all drives ignore torques
  Vector encoders = {};   ///< -1: the encoder counts against the torque; empty: none does
  double cogging_Nm = 0;  ///< amplitude, 200 periods a turn
  /// Steps of the torque, which has none at zero [N m]; empty: the torque has no steps.
  Vector torque_steps = {};
  bool carries = false;  ///< what a step leaves over is added in the next tick
};

class FaultyArm final : public EmulatedArm {
 public:
  FaultyArm(const scenario::Scenario& scenario, DriveFaults faults)
      : EmulatedArm(scenario), faults_(std::move(faults)), first_(state().q) {}

  void start() override {
    EmulatedArm::start();
    last_ = Vector::Zero(first_.size());
    sent_.assign(static_cast<std::size_t>(faults_.torque_delay), Vector::Zero(first_.size()));
  }
  void hold(const Vector& tau, double until_s) override {
    last_ = tau;
    Vector acts = in_steps(tau).cwiseProduct(faults_.scale);
    if (faults_.encoders.size() > 0) acts = acts.cwiseProduct(faults_.encoders);
    acts += faults_.cogging_Nm * (200 * state().q).array().sin().matrix();
    sent_.push_back(acts);
    if (!faults_.braked) EmulatedArm::hold(sent_.front(), until_s);
    sent_.pop_front();
    moved = moved.cwiseMax((state().q - first_).cwiseAbs());
    fastest = fastest.cwiseMax(state().v.cwiseAbs());
  }

  plant::ArmState read() override {
    plant::ArmState seen = EmulatedArm::read();
    for (Vector* of_motors : {&seen.theta, &seen.thetadot}) of_motors->resize(0);
    return seen;
  }
  void rest(double until_s) override {
    if (moves()) hold(faults_.zeroes ? Vector::Zero(first_.size()) : last_, until_s);
  }

 private:
  Vector in_steps(const Vector& tau) {
    if (faults_.torque_steps.size() == 0) return tau;
    const Vector wanted = tau + rest_;
    const Vector steps = wanted.cwiseQuotient(faults_.torque_steps);
    Vector acts = faults_.torque_steps.array() * (steps.array().floor() + 0.5);
    if (faults_.carries) rest_ = wanted - acts;
    return acts;
  }

  DriveFaults faults_;
  Vector first_, last_;
  Vector rest_ = Vector::Zero(first_.size());  ///< torque that the last step left over
  std::deque<Vector> sent_;                    ///< torques that do not act yet

 public:
  /// Largest deflection from the start [rad; m], and largest speed.
  Vector moved = Vector::Zero(first_.size()), fastest = moved;
};

/// An arm whose ticks are the clock of the run.
class ClockedArm final : public plant::ClockDriver {
 public:
  ClockedArm(FaultyArm& arm, double period_s) : arm_(arm), period_s_(period_s) {}

  [[nodiscard]] bool measures_velocity() const override { return false; }
  void start() override {
    arm_.start();
    ticks_ = -1;
  }
  void stop() override { arm_.stop(); }

 private:
  plant::ArmState exchange(const Vector& tau) override {
    const double until_s = static_cast<double>(++ticks_) * period_s_;
    if (tau.size() > 0) {
      arm_.hold(tau, until_s);
    } else if (ticks_ > 0) {
      arm_.rest(until_s);
    }
    return arm_.read();
  }

  FaultyArm& arm_;
  double period_s_;
  std::int64_t ticks_ = 0;
};

struct ArmKind {
  const char* scenario;
  std::vector<double> posture;
  std::vector<double> rotor;     ///< [kg m^2]
  std::vector<double> friction;  ///< dry friction [N m]
  std::string torque_limit;
  int bits;
};

inline const std::vector<ArmKind> kinds = {
    {"practical_rigid", {0.25, 0.2}, {0.5, 0.1}, {0.5, 0.1}, "[400, 100]", 20},
    {"practical_rigid", {2.9, 0.25}, {1, 0.2}, {1, 0.15}, "[400, 100]", 19},
    {"ur5e",
     {0.2, -1.4, 0.3, -1.4, 0.4, 0.3},
     {0.7, 0.7, 0.7, 0.2, 0.2, 0.2},
     {0.6, 0.6, 0.6, 0.1, 0.1, 0.1},
     "[150, 150, 150, 28, 28, 28]",
     21},
    {"iiwa_point_to_point",
     {0.3, 0.15, -0.4, -0.2, 0.3, 0.3, 0.2},
     {0.6, 0.6, 0.4, 0.4, 0.2, 0.1, 0.1},
     {0.5, 0.5, 0.3, 0.3, 0.2, 0.1, 0.1},
     "[320, 320, 176, 176, 110, 40, 40]",
     22},
    {"fr3",
     {0.1, -0.7854, 0.2, -2.3562, 0.1, 1.5708, 0.7854},
     {0.6, 0.6, 0.5, 0.5, 0.2, 0.2, 0.1},
     {0.6, 0.6, 0.5, 0.5, 0.2, 0.2, 0.1},
     "[87, 87, 87, 87, 12, 12, 12]",
     24}};

/// Faults of an adverse arm. The first four kinds have to be named.
enum class Fault {
  brakes,
  reversed,
  hundredfold,
  flexible,
  ignored,
  brake,
  payload,
  wall,
  cogging,
  none
};
constexpr std::array<std::string_view, 10> names(Fault /*type*/) {
  return {"brakes", "reversed", "hundredfold", "flexible", "ignored",
          "brake",  "payload",  "wall",        "cogging",  "none"};
}

/// An arm, and the scenario of somebody who does not know its conventions and faults.
struct Hidden {
  scenario::Scenario claimed, truth;
  DriveFaults more;
  Fault fault = Fault::none;
  Eigen::Index joint = 0;  ///< that has the fault, if one joint has it
};

/// Returns the joints of an arm whose links swing at `hz` while their motors are held.
inline std::string springs(const scenario::Scenario& scenario, const ArmKind& kind, double hz) {
  const Vector stiffness =
      std::pow(2 * std::numbers::pi * hz, 2) *
      robot::mass_matrix(*scenario.model, scenario.plant.initial.position_rad).diagonal();
  return fmt::format(
      "robot.joints={{flexible: {{stiffness_Nm_per_rad: {}, rotor_inertia_kgm2: [{}], "
      "spring_damping_Nms_per_rad: {}}}}}",
      list(stiffness), fmt::join(kind.rotor, ", "), list(2e-3 * stiffness / hz));
}

/// Draws an arm.
/// @param wild true: scales of torque between 0.7 and 1.4; false: within 5 % of 1
inline Hidden draw(std::mt19937& random, const ArmKind& kind, bool friction, bool wild,
                   Fault fault = Fault::none) {
  std::uniform_real_distribution<double> part(0, 1);
  const auto flip = [&](double share) { return part(random) < share; };
  const auto n = static_cast<Eigen::Index>(kind.posture.size());
  Vector signs = Vector::Ones(n), posture(n), scale = signs;
  for (Eigen::Index i = 0; i < n; ++i) {
    posture[i] = kind.posture[static_cast<std::size_t>(i)];
    if (flip(0.25)) signs[i] = -1;
    scale[i] = wild ? 0.7 * std::pow(2, part(random)) : 0.95 + 0.1 * part(random);
  }
  // An arm whose posture has another sign may be outside of its ranges.
  if (std::string_view(kind.scenario) == "fr3") signs.setOnes();
  const double which = part(random);
  std::string compensates =
      which < 0.4 ? "{}"
                  : (which < 0.7 || !friction ? "{gravity: true}" : "{gravity: true, friction: 1}");
  const int delay = static_cast<int>(5 * part(random)),
            of_reading = static_cast<int>((delay + 1) * part(random));
  DriveFaults drives{scale, delay - of_reading, flip(0.5), flip(0.5)};
  const auto joint = static_cast<Eigen::Index>(part(random) * static_cast<double>(n));
  const double amount = part(random);

  const std::string path = fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR, kind.scenario);
  const auto with = [&](const Vector& q, std::vector<std::string> more) {
    more.insert(
        more.begin(),
        {"plant.mechanics=native", "plant.integrator.accuracy=1e-8", "plant.on_limit=warn",
         fmt::format("plant.encoder.resolution_bits={}", kind.bits), "loop.command_delay=1",
         "plant.drive.torque_limit_Nm=" + kind.torque_limit, "plant.encoder.latency_ticks=0",
         "robot.compensates={}", fmt::format("plant.initial.position_rad={}", list(q)),
         fmt::format("reference={{hold: {{position_rad: {}}}}}", list(q)),
         fmt::format("robot.joints={{rigid: {{rotor_inertia_kgm2: [{}]}}}}",
                     fmt::join(kind.rotor, ", "))});
    return scenario::load_scenario(path, more);
  };
  Vector rubs = Vector::Zero(n);
  for (Eigen::Index i = 0; friction && i < n; ++i) {
    rubs[i] = kind.friction[static_cast<std::size_t>(i)];
  }
  const std::string known = fmt::format("plant.drive.coulomb_friction_Nm={}", list(rubs));
  if (fault == Fault::brake) {
    rubs[joint] = 1e4;
    if (compensates != "{}") compensates = "{gravity: true}";
  }
  std::vector<std::string> truth = {fmt::format("plant.drive.coulomb_friction_Nm={}", list(rubs)),
                                    "robot.joint_signs=" + list(signs),
                                    "robot.compensates=" + compensates,
                                    fmt::format("plant.encoder.latency_ticks={}", of_reading)};
  if (fault == Fault::payload) {
    truth.push_back(fmt::format("plant.payload={{mass_kg: {}}}", 1 + 2 * amount));
  }
  if (fault == Fault::wall) truth.emplace_back("robot.base={rpy: [0, 1.5708, 0]}");
  if (fault == Fault::flexible) {
    truth.push_back(springs(with(posture, {}), kind, 8 + 7 * amount));
    // The friction is of the motors then.
    truth.front() = "plant.drive.coulomb_friction_Nm=0";
  }
  drives.braked = fault == Fault::brakes || fault == Fault::ignored;
  if (fault == Fault::reversed) {
    drives.encoders = Vector::Ones(n);
    drives.encoders[joint] = -1;
  }
  if (fault == Fault::hundredfold) drives.scale *= 100;
  if (fault == Fault::cogging) drives.cogging_Nm = 0.3 + 0.7 * amount;
  return {with(signs.cwiseProduct(posture), {known}), with(posture, truth), drives, fault, joint};
}

}  // namespace tachless::commission
