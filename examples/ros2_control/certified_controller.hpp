#pragma once

#include <memory>
#include <string>
#include <vector>

#include <tachless/own_loop/own_loop.h>
#include <controller_interface/controller_interface.hpp>

namespace tachless_controllers {

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::return_type;

/// A controller of ros2_control: positions in, efforts out. Its only state interface is `position`,
/// so it also serves arms whose velocity joint_trajectory_controller needs and nobody measures.
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
  CallbackReturn on_configure(const rclcpp_lifecycle::State& state) override;
  CallbackReturn on_activate(const rclcpp_lifecycle::State& state) override;
  return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) override;

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
