#include "plant/drivers/ur/ur_driver.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <exception>
#include <string_view>
#include <thread>

#include "base/clock.h"
#include "base/failure.h"
#include "base/logging.h"
#include "base/text.h"
#include "scenario/driver_settings.h"

namespace tachless::ur {
namespace {

using namespace std::chrono_literals;
using base::Clock;
using base::ExitCode;
using base::Failure;

constexpr int num_joints = 6;
constexpr std::int32_t normal = 1, reduced = 2;  // of safety_status

/// Returns the words for a value of RTDE's safety_status.
std::string_view safety_text(std::int32_t status) {
  constexpr std::array<std::string_view, 14> words = {
      "an unknown state",
      "normal",
      "reduced",
      "a protective stop: see the pendant for its cause, and unlock it there",
      "recovery: a joint is beyond its safety limit; move it back on the pendant",
      "a safeguard stop: reset the safeguard",
      "an emergency stop of the system: release it",
      "an emergency stop of the arm: release it",
      "a violation of the safety limits: restart the safety system on the pendant",
      "a fault: restart the arm",
      "joints that are being identified",
      "an undefined state",
      "a safeguard stop of the automatic mode: reset the safeguard",
      "a stop of the three-position switch: hold it in the middle"};
  const bool known = status > 0 && static_cast<std::size_t>(status) < words.size();
  return words[known ? static_cast<std::size_t>(status) : 0];
}

Vector vector_of(const urcl::vector6d_t& numbers) {
  return Eigen::Map<const Eigen::VectorXd>(numbers.data(), num_joints);
}

}  // namespace

std::optional<base::Refusal> Payload::refusal() const {
  if (center_m.size() == 3) return {};
  return base::Refusal{"center_m", fmt::format("{} numbers; allowed: 3", center_m.size())};
}

UrDriver::UrDriver(const scenario::Scenario& scenario)
    : settings_(scenario::driver_settings<Settings>(scenario)) {
  if (scenario.num_joints != num_joints) {
    throw scenario.complaint("robot.urdf", "{} joints; an arm of Universal Robots has 6",
                             scenario.num_joints);
  }
  urcl::UrDriverConfiguration config;
  config.robot_ip = settings_.address;
  config.script_file = settings_.script;
  config.output_recipe = {"timestamp", "actual_q", "actual_qd", "safety_status"};
  config.input_recipe = {"speed_slider_mask", "speed_slider_fraction"};
  config.headless_mode = settings_.headless;
  config.reverse_ip = settings_.reverse_address;
  config.handle_program_state = [this](bool runs) { program_runs_ = runs; };
  try {
    arm_ = std::make_unique<urcl::UrDriver>(config);
    require_version();
    package_ = std::make_unique<urcl::rtde_interface::DataPackage>(arm_->getRTDEOutputRecipe());
    wait_for_program();
    arm_->startRTDECommunication();
    update();
  } catch (const Failure&) {
    throw;
  } catch (const std::exception& error) {
    throw refused(base::one_line(error.what()));
  }
  if (lost_) throw refused("it sends no states (RTDE, port 30004): see the network");
}

Failure UrDriver::refused(std::string_view problem) const {
  return base::bad_usage("the arm at {} (plant.driver.address): {}", settings_.address, problem);
}

void UrDriver::require_version() const {
  const urcl::VersionInformation version = arm_->getVersion();
  const std::string needed = version.major >= 10 ? "10.12.1" : "5.25.1";
  if (version >= urcl::VersionInformation::fromString(needed)) return;
  throw refused(
      fmt::format("its PolyScope {}.{}.{} does not set the shares of friction that it "
                  "cancels; update it to {} or later",
                  version.major, version.minor, version.bugfix, needed));
}

void UrDriver::wait_for_program() {
  const auto end = Clock::now() + base::nanoseconds_of(settings_.start_wait_s);
  while (!program_runs_) {
    if (Clock::now() > end) {
      throw refused(fmt::format(
          "its program did not start within {} s: {}", base::shortest(settings_.start_wait_s),
          settings_.headless ? "set the arm to remote control, power it on, and release "
                               "its brakes"
                             : "start the program with the node External Control"));
    }
    std::this_thread::sleep_for(5ms);
  }
}

void UrDriver::start() {
  const urcl::vector6d_t none{};
  if (!arm_->setFrictionScales(none, none)) {
    throw refused("it did not take the friction scales: its program has ended");
  }
  base::log_info("the arm's own compensation of friction is off: both friction scales are 0");
  if (settings_.payload.mass_kg) {
    const auto& center = settings_.payload.center_m;
    if (!arm_->setTargetPayload(static_cast<float>(*settings_.payload.mass_kg),
                                {center[0], center[1], center[2]})) {
      throw refused("it did not take the payload: its program has ended");
    }
  }
  running_ = true;
}

void UrDriver::stop() {
  if (lost_) {
    throw plant::StopsByItself(fmt::format("the arm's program brakes it {} s after the last torque",
                                           base::shortest(settings_.command_timeout_s)));
  }
  if (!running_) return;
  running_ = false;
  if (!arm_->stopControl()) {
    throw plant::StopsByItself("the arm's program has ended, and the arm brakes by itself");
  }
}

plant::ArmState UrDriver::exchange(const Vector& tau) {
  if (lost_) {  // `rest` is called on after the failure
    std::this_thread::sleep_for(1ms);
    plant::ArmState none;
    none.missing = true;
    return none;
  }
  bool taken = true;
  if (running_ && tau.size() == num_joints) {
    urcl::vector6d_t torque{};
    Vector::Map(torque.data(), num_joints) = tau;
    const auto timeout_ms = static_cast<unsigned>(std::lround(1e3 * settings_.command_timeout_s));
    taken = arm_->writeJointCommand(torque, urcl::comm::ControlMode::MODE_TORQUE,
                                    urcl::RobotReceiveTimeout::millisec(timeout_ms));
    ++sent_;
  }
  update();
  if (lost_) {
    throw Failure(ExitCode::protective_stop,
                  "the arm at {} sent no state for 100 ms: see the network and the arm's power",
                  settings_.address);
  }
  if (running_ && !taken) program_runs_ = false;
  if (running_) require_running();
  return now_;
}

void UrDriver::update() {
  lost_ = !arm_->getDataPackage(*package_);
  if (lost_) {
    running_ = false;
    return;
  }
  urcl::vector6d_t q{}, v{};
  package_->getData("actual_q", q);
  package_->getData("actual_qd", v);
  package_->getData("timestamp", now_.time_s);
  package_->getData("safety_status", safety_);
  now_.q = vector_of(q);
  now_.v = vector_of(v);
}

void UrDriver::require_running() {
  const bool safe = safety_ == normal || safety_ == reduced;
  if (safe && program_runs_) return;
  running_ = false;  // the arm has stopped itself
  if (!safe) {
    throw Failure(ExitCode::protective_stop, "the arm: {}", safety_text(safety_));
  }
  throw Failure(ExitCode::protective_stop,
                "the arm's program has ended: no torque came for {} s, or somebody stopped it on "
                "the pendant",
                base::shortest(settings_.command_timeout_s));
}

std::vector<plant::DriverFigure> UrDriver::figures() const {
  return {{"torques_sent", static_cast<double>(sent_)},
          {"friction_scale", 0},
          {"safety_status", static_cast<double>(safety_)}};
}

}  // namespace tachless::ur
