// A controller of ros2_control: positions in, efforts out. Its only state interface is `position`,
// so it also serves arms whose velocity joint_trajectory_controller needs and nobody measures.
// on_configure certifies the scenario's loop at the controller manager's rate, or refuses it with
// the reason. Compiled against stubs of ROS 2, and not run under ROS 2.
#include <cmath>
#include <exception>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <tachless/own_loop/own_loop.h>
#include <controller_interface/controller_interface.hpp>
#include <pluginlib/class_list_macros.hpp>

namespace tachless_controllers {

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::return_type;

class CertifiedController : public controller_interface::ControllerInterface {
 public:
  InterfaceConfiguration command_interface_configuration() const override {
    return each("/effort");
  }
  InterfaceConfiguration state_interface_configuration() const override {
    return each("/position");
  }

  CallbackReturn on_init() override {
    auto_declare<std::string>("scenario", "");
    auto_declare<std::vector<std::string>>("joints", {});
    return CallbackReturn::SUCCESS;
  }

  // Not in real time: reads, certifies (0.2 s for seven joints) and allocates.
  CallbackReturn on_configure(const rclcpp_lifecycle::State&) override {
    joints_ = get_node()->get_parameter("joints").as_string_array();
    try {
      const std::string scenario = get_node()->get_parameter("scenario").as_string();
      loop_ = std::make_unique<tachless::CertifiedLoop>(scenario);
      guards_ = std::make_unique<tachless::Guards>(*loop_);
      if (std::abs(1.0 / get_update_rate() - loop_->period_s()) > 1e-9) {
        throw std::runtime_error(scenario + ": loop.period_s is not the controller's update_rate");
      }
      if (joints_ != loop_->joints()) {
        throw std::runtime_error(scenario + ": its joints are not the parameter joints, in order");
      }
    } catch (const std::exception& refusal) {
      RCLCPP_ERROR(get_node()->get_logger(), "%s", refusal.what());
      return CallbackReturn::ERROR;
    }
    q_.assign(joints_.size(), 0.0);
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State&) override {
    tick_ = -1;
    loop_->reset();
    guards_->reset();
    return CallbackReturn::SUCCESS;
  }

  // A reading that is missing leaves its tick out: the law steps over it at the next one. After
  // ERROR the manager deactivates the controller, and the hardware has to brake.
  return_type update(const rclcpp::Time&, const rclcpp::Duration&) override {
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

 private:
  InterfaceConfiguration each(const std::string& interface) const {
    InterfaceConfiguration all{controller_interface::interface_configuration_type::INDIVIDUAL, {}};
    for (const auto& joint : joints_) all.names.push_back(joint + interface);
    return all;
  }

  std::vector<std::string> joints_;
  std::unique_ptr<tachless::CertifiedLoop> loop_;
  std::unique_ptr<tachless::Guards> guards_;
  std::vector<double> q_;
  std::int64_t tick_ = -1;
};

}  // namespace tachless_controllers

PLUGINLIB_EXPORT_CLASS(tachless_controllers::CertifiedController,
                       controller_interface::ControllerInterface)
