#include "certify/feasibility.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string_view>
#include <variant>

#include "certify/feedforward_bound.h"
#include "controller/law/loria_ortega_bounded.h"
#include "controller/registry.h"
#include "linear/scenario_loop.h"
#include "plant/motion_guard.h"
#include "robot/dynamics.h"
#include "robot/model.h"

namespace tachless::certify {
namespace {

using messages::ReferencePoint;

// A loop is usually sampled 10 to 30 times in a period of its bandwidth (K. Åström, B. Wittenmark,
// Computer-Controlled Systems).
constexpr double fastest_cycles_per_tick = 0.1;

/// How fast a reference moves.
struct Pace {
  std::string key;
  std::string_view question;  ///< the likely mistake in its value
  /// Per joint the highest frequency that the key gives [Hz], of whatever amplitude; nothing: it
  /// gives times.
  std::optional<Vector> frequency_hz;
};

Pace pace_of(const scenario::Scenario& scenario) {
  Pace pace;
  const auto look_at = [&]<class Kind>(const Kind& kind) {
    pace.key = fmt::format("reference.{}", Kind::name);
    pace.question = "times are in s, was another unit given?";
    if constexpr (requires { kind.frequency_hz; }) pace.key += ".frequency_hz";
    if constexpr (requires { kind.terms; }) pace.key += ".terms";
  };
  std::visit(look_at, scenario.reference);
  const reference::trajectory::Composition parts = reference::composition_of(scenario.reference);
  for (const auto& sine : parts.sines) {
    pace.question = "frequencies are in Hz, was rad/s given?";
    if (!pace.frequency_hz) pace.frequency_hz = Vector::Zero(scenario.num_joints);
    const Vector moving = (sine.amplitude_rad.array() == 0).select(0.0, sine.frequency_hz);
    pace.frequency_hz = pace.frequency_hz->cwiseMax(moving).eval();
  }
  return pace;
}

/// Torque of the drives on the reference: inverse dynamics and friction, and with flexible joints
/// what turns the rotors.
Vector drive_torque(const scenario::Scenario& scenario, const robot::Model& model,
                    const ReferencePoint& r) {
  const plant::DriveSpec& joints = scenario.plant.drive;
  const auto& drive = scenario.robot.flexible;
  const robot::JetVector links = controller::law::feedforward_torque(model, r);
  Vector torque = robot::value(links) + joints.viscous_friction_Nms_per_rad.cwiseProduct(r.v_ref);
  const Vector gravity =
      joints.load_friction.isZero(0) ? Vector(0 * torque) : robot::gravity_torque(model, r.q_ref);
  for (Eigen::Index i = 0; i < torque.size(); ++i) {
    torque[i] += joints.friction_of(i).kinetic(r.v_ref[i], gravity[i]);
  }
  if (!drive) return torque;
  const Vector thetadot = r.v_ref + robot::first_derivative(links).cwiseQuotient(drive->stiffness);
  const Vector thetaddot =
      r.a_ref + robot::second_derivative(links).cwiseQuotient(drive->stiffness);
  torque += drive->rotor_inertia.cwiseProduct(thetaddot);
  torque += drive->motor_damping.cwiseProduct(thetadot);
  torque += drive->motor_coulomb_friction_Nm.cwiseProduct(thetadot.cwiseSign());
  return torque;
}

void judge(Feasibility& result, const scenario::Scenario& scenario, const robot::Model& model,
           const Pace& pace) {
  const robot::JointLabels labels = robot::joint_labels(model);
  for (std::size_t i = 0; i < result.joints.size(); ++i) {
    const JointDemand& joint = result.joints[i];
    const std::string name = labels.joint(i);
    const std::string& effort = labels.effort[i];
    if (joint.torque_limit && joint.at_rest > *joint.torque_limit) {
      result.impossible.push_back(
          fmt::format("{} needs {:.4g} {} to stand still, and its limit is {:g} {}; raise "
                      "plant.drive.torque_limit_Nm if the limit is wrong, as in many URDFs, or "
                      "choose other postures",
                      name, joint.at_rest, effort, *joint.torque_limit, effort));
    } else if (joint.torque_limit && joint.moving > *joint.torque_limit) {
      result.impossible.push_back(
          fmt::format("{} needs up to {:.4g} {} to follow the reference, and its limit is {:g} {}; "
                      "slow the reference down or raise plant.drive.torque_limit_Nm",
                      name, joint.moving, effort, *joint.torque_limit, effort));
    }
    const auto& tight = joint.tight_speed;
    if (tight && tight->speed > tight->limit) {
      result.impossible.push_back(fmt::format(
          "{} is to move at {:.4g} {}/s at {:.4g} s, where it is at {:.4g} {}, and the URDF allows "
          "{:.4g} {}/s so near to the end of its range; slow the reference down or keep away from "
          "the end",
          name, tight->speed, labels.length[i], tight->at_s, tight->position, labels.length[i],
          tight->limit, labels.length[i]));
    } else if (joint.speed_limit && joint.speed > *joint.speed_limit) {
      result.impossible.push_back(
          fmt::format("{} is to move at up to {:.4g} {}/s, and the URDF allows {:g} {}/s; slow the "
                      "reference down",
                      name, joint.speed, labels.length[i], *joint.speed_limit, labels.length[i]));
    }
    if (joint.cycles_per_tick > fastest_cycles_per_tick) {
      result.doubtful.push_back(fmt::format(
          "{}: {:.4g} Hz for {} is more than a tenth of the sampling rate of {:.4g} Hz; {}",
          pace.key, joint.cycles_per_tick / scenario.loop.period_s, name,
          1 / scenario.loop.period_s, pace.question));
    }
    const Vector& q = scenario.plant.initial.position_rad;
    const auto k = static_cast<Eigen::Index>(i);
    if (model.joint_types[i] == robot::JointType::revolute &&
        std::abs(q[k]) > 2 * std::numbers::pi) {
      result.doubtful.push_back(
          fmt::format("plant.initial.position_rad: {:g} rad for {} is more than a full turn; "
                      "angles are in rad, were degrees given?",
                      q[k], name));
    }
  }
}

/// Examines the bound of a bounded law's feed-forward. The clip of the feed-forward must never act,
/// and the bound must leave a torque for the feedback.
void judge_feedforward(Feasibility& result, const scenario::Scenario& scenario) {
  using controller::law::LoriaOrtegaBounded;
  if (scenario.controller.law != LoriaOrtegaBounded::name) return;
  // Shares of a torque limit: the feedback has the rest, a fifth at least. A proposed bound that is
  // sampled has a reserve, since the largest torque may be between the sampled postures.
  constexpr double most_share = 0.8, usual_share = 0.7, reserve = 1.02;
  const auto law = controller::make_law<LoriaOrtegaBounded>(scenario);
  const auto [anywhere, proved] = feedforward_bound(scenario);
  const robot::JointLabels labels = robot::joint_labels(*scenario.model);
  // A proved bound needs a reserve for the rounding of the printed number alone.
  const Vector remedy_Nm = (proved ? 1.001 : reserve) * anywhere;
  const std::string remedy =
      fmt::format("--set 'controller.gains.feedforward_max=[{:.4g}]'", fmt::join(remedy_Nm, ", "));
  for (std::size_t i = 0; i < result.joints.size(); ++i) {
    JointDemand& joint = result.joints[i];
    const auto k = static_cast<Eigen::Index>(i);
    const double bound = law.feedforward_max()[k];
    const double share = 1 - law.feedback_max()[k] / *joint.torque_limit;
    joint.feedforward_max = bound;
    joint.feedforward_anywhere = anywhere[k];
    joint.feedforward_proved = proved;
    const std::string bound_text =
        fmt::format("feedforward_max of {} is {:.4g} {}", labels.joint(i), bound, labels.effort[i]);
    if (joint.moving > bound) {
      result.impossible.push_back(
          fmt::format("{}, and the reference needs {:.4g}; {}", bound_text, joint.moving, remedy));
    } else if (anywhere[k] > bound) {
      result.doubtful.push_back(fmt::format(
          "{}, and the reference needs {}{:.4g} at some posture: the proof does not hold; {}",
          bound_text, proved ? "up to " : "", anywhere[k], remedy));
    }
    const std::string left = fmt::format(
        "{}{}, {:.0f} % of the limit: it leaves too little for the feedback; slow the reference "
        "down and lower it",
        bound_text, law.integral() == nullptr ? "" : ", with d_max", 100 * share);
    if (share > most_share) {
      result.impossible.push_back(left);
    } else if (share > usual_share + 1e-9) {
      result.doubtful.push_back(left);
    }
  }
}

/// Takes the speed at `r` for the tightest one if its share of the limit there is larger.
void tighten(std::optional<TightSpeed>& tight, const plant::MotionGuard& guard, Eigen::Index joint,
             double t_s, const ReferencePoint& r) {
  const double v = r.v_ref[joint], q = r.q_ref[joint];
  const TightSpeed now{t_s, q, std::abs(v), guard.speed_limit(joint, q, v)};
  // Without a division: a limit may be 0.
  if (!tight || now.speed * tight->limit > tight->speed * now.limit) tight = now;
}

}  // namespace

Feasibility feasibility(const scenario::Scenario& scenario) {
  const robot::Model model = linear::plant_of(scenario);
  const plant::MotionGuard guard(model, scenario.robot.urdf_path);
  std::vector<std::optional<TightSpeed>> tight(static_cast<std::size_t>(model.num_joints));
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  Vector at_rest = Vector::Zero(model.num_joints), moving = at_rest, speed = at_rest,
         acceleration = at_rest;
  for (const double t_s : reference::Motion(scenario, trajectory).closely()) {
    const ReferencePoint r = trajectory.at(t_s);
    at_rest = at_rest.cwiseMax(robot::gravity_torque(model, r.q_ref).cwiseAbs());
    moving = moving.cwiseMax(drive_torque(scenario, model, r).cwiseAbs());
    speed = speed.cwiseMax(r.v_ref.cwiseAbs());
    acceleration = acceleration.cwiseMax(r.a_ref.cwiseAbs());
    for (Eigen::Index i = 0; i < model.num_joints; ++i) {
      if (guard.slows_near_ends(i)) tighten(tight[static_cast<std::size_t>(i)], guard, i, t_s, r);
    }
  }
  const Pace pace = pace_of(scenario);
  const robot::JointLabels labels = robot::joint_labels(*scenario.model);
  const auto& limit = scenario.plant.drive.torque_limit_Nm;
  Feasibility result;
  for (Eigen::Index i = 0; i < model.num_joints; ++i) {
    JointDemand demand{model.joint_names[static_cast<std::size_t>(i)], at_rest[i], moving[i],
                       speed[i]};
    if (limit && std::isfinite((*limit)[i])) demand.torque_limit = (*limit)[i];
    if (std::isfinite(model.velocity_limit[i])) demand.speed_limit = model.velocity_limit[i];
    demand.torque_unit = labels.effort[static_cast<std::size_t>(i)];
    demand.speed_unit = labels.length[static_cast<std::size_t>(i)] + "/s";
    demand.tight_speed = tight[static_cast<std::size_t>(i)];
    if (pace.frequency_hz) {
      demand.cycles_per_tick = (*pace.frequency_hz)[i] * scenario.loop.period_s;
    } else if (speed[i] > 0) {
      demand.cycles_per_tick =
          acceleration[i] / speed[i] / (2 * std::numbers::pi) * scenario.loop.period_s;
    }
    result.joints.push_back(demand);
  }
  judge(result, scenario, model, pace);
  judge_feedforward(result, scenario);
  return result;
}

}  // namespace tachless::certify
