// A stand-in for drake-iiwa-driver and its arm, for tests of the driver without them: iiwa_rig
// SCENARIO. The arm compensates gravity itself and keeps its own time. It is held after 50 ms
// without a command.

#include <cmath>

#include <tachless/plant/plant_model.h>
#include <tachless/robot/dynamics.h>
#include <tachless/session/options.h>
#include "channels.h"

using namespace tachless;

namespace {

using namespace std::chrono_literals;

constexpr double longest_step_s = 1e-4;
constexpr double count = 1e-6;  // [rad]

std::vector<double> numbers_of(const Vector& x) { return {x.begin(), x.end()}; }

void play(const scenario::Scenario& scenario) {
  robot::Model model = plant::plant_model(scenario);
  model.gravity.setZero();  // the arm's own controller compensates it
  Vector q = plant::initial_state(scenario.plant, scenario.robot.flexible, model).q;
  Vector v = Vector::Zero(model.num_joints), tau = v;
  iiwa::Channels<drake::lcmt_iiwa_status, drake::lcmt_iiwa_command> channels(
      bus::parse_lcm_url(""), iiwa::status_channel, iiwa::command_channel);
  drake::lcmt_iiwa_status status{};
  drake::lcmt_iiwa_command command{};
  status.num_joints = model.num_joints;
  for (auto* unused : {&status.joint_position_commanded, &status.joint_position_ipo,
                       &status.joint_torque_measured, &status.joint_torque_external}) {
    *unused = numbers_of(Vector::Zero(model.num_joints));
  }
  const double h = scenario.loop.period_s;
  const auto steps = static_cast<int>(std::ceil(h / longest_step_s));
  const double step_s = h / steps;
  const auto start = base::Clock::now();
  auto commanded = start - 1s;
  for (std::int64_t k = 0;; ++k) {
    const auto begin = start + std::chrono::nanoseconds(std::llround(1e9 * h * double(k)));
    while (base::Clock::now() < begin) {
      if (!channels.receive(command, begin)) continue;
      if (command.num_torques != model.num_joints) continue;
      tau = Eigen::Map<const Eigen::VectorXd>(command.joint_torque.data(), model.num_joints);
      commanded = base::Clock::now();
    }
    status.utime = std::llround(1e6 * h * double(k));
    status.joint_position_measured = numbers_of((q / count).array().round() * count);
    status.joint_velocity_estimated = numbers_of(v);
    status.joint_torque_commanded = numbers_of(tau);
    channels.send(status);
    const bool held = base::Clock::now() - commanded > 50ms;
    for (int i = 0; i < steps; ++i) {
      if (held) {
        v.setZero();
      } else {
        v += step_s * robot::forward_dynamics(model, q, v, tau);
      }
      q += step_s * v;
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  play(scenario::load_scenario(argv[1]));
}
