// The certified law as a controller of ros2_control: docs/ros2_control.md. Compiled against stubs
// of ROS 2, and not run under ROS 2.
#include "certified_controller.hpp"

#include <cmath>
#include <exception>
#include <stdexcept>

#include <pluginlib/class_list_macros.hpp>

namespace tachless_controllers {

// Certifies the scenario's loop at the controller manager's rate, or refuses it with the reason.
// Not in real time: it reads, certifies (0.2 s for seven joints) and allocates.
CallbackReturn CertifiedController::on_configure(const rclcpp_lifecycle::State&) try {
  joints_ = get_node()->get_parameter("joints").as_string_array();
  const std::string scenario = get_node()->get_parameter("scenario").as_string();
  loop_ = std::make_unique<tachless::CertifiedLoop>(scenario);
  guards_ = std::make_unique<tachless::Guards>(*loop_);
  if (std::abs(1.0 / get_update_rate() - loop_->period_s()) > 1e-9) {
    throw std::runtime_error(scenario + ": loop.period_s is not the controller's update_rate");
  }
  if (joints_ != loop_->joints()) {
    throw std::runtime_error(scenario + ": its joints are not the parameter joints, in order");
  }
  q_.assign(joints_.size(), 0.0);
  return CallbackReturn::SUCCESS;
} catch (const std::exception& refusal) {
  RCLCPP_ERROR(get_node()->get_logger(), "%s", refusal.what());
  return CallbackReturn::ERROR;
}

CallbackReturn CertifiedController::on_activate(const rclcpp_lifecycle::State&) {
  tick_ = -1;
  loop_->reset();
  guards_->reset();
  return CallbackReturn::SUCCESS;
}

// A missing reading leaves its tick out: the law steps over it at the next one. After ERROR the
// manager deactivates the controller, and the hardware has to brake.
return_type CertifiedController::update(const rclcpp::Time&, const rclcpp::Duration&) {
  ++tick_;
  for (std::size_t i = 0; i < q_.size(); ++i) {
    const auto value = state_interfaces_[i].get_optional();
    if (!value) return return_type::OK;
    q_[i] = *value;
  }
  const auto step = guards_->check(loop_->torque(tick_, q_));
  if (!step.ok()) {
    RCLCPP_ERROR(get_node()->get_logger(), "%s", guards_->reason(step).c_str());
    return return_type::ERROR;
  }
  bool sent = true;
  for (std::size_t i = 0; i < q_.size(); ++i) {
    sent = command_interfaces_[i].set_value(step.tau[i]) && sent;
  }
  return sent ? return_type::OK : return_type::ERROR;
}

}  // namespace tachless_controllers

PLUGINLIB_EXPORT_CLASS(tachless_controllers::CertifiedController,
                       controller_interface::ControllerInterface)
