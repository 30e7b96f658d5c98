#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

// A stand-in for the parts of ROS 2 (controller_interface 6.8, rclcpp) that examples/ros2_control
// uses. It has their names and signatures. It is neither their ABI nor their lifecycle.
#define RCLCPP_ERROR(logger, format, text) (logger).last = (text)

namespace rclcpp {

class Time {};
class Duration {};

struct Logger {
  std::string last;
};

class Parameter {
 public:
  std::variant<std::string, std::vector<std::string>> value;
  [[nodiscard]] std::string as_string() const { return std::get<0>(value); }
  [[nodiscard]] std::vector<std::string> as_string_array() const { return std::get<1>(value); }
};

}  // namespace rclcpp

namespace rclcpp_lifecycle {

class State {};

class LifecycleNode {
 public:
  std::map<std::string, rclcpp::Parameter> parameters;
  rclcpp::Logger logger;
  rclcpp::Parameter get_parameter(const std::string& name) { return parameters.at(name); }
  rclcpp::Logger& get_logger() { return logger; }
};

}  // namespace rclcpp_lifecycle

namespace hardware_interface {

struct LoanedStateInterface {
  std::optional<double> value;
  [[nodiscard]] std::optional<double> get_optional() const { return value; }
};

struct LoanedCommandInterface {
  double value = 0;
  [[nodiscard]] bool set_value(double given) {
    value = given;
    return true;
  }
};

}  // namespace hardware_interface

namespace controller_interface {

enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };

struct InterfaceConfiguration {
  interface_configuration_type type = interface_configuration_type::NONE;
  std::vector<std::string> names;
};

class ControllerInterface {
 public:
  virtual ~ControllerInterface() = default;
  [[nodiscard]] virtual InterfaceConfiguration command_interface_configuration() const = 0;
  [[nodiscard]] virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_init() = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State& previous) = 0;
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State& previous) = 0;
  virtual return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) = 0;

  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return node_; }
  [[nodiscard]] unsigned get_update_rate() const { return update_rate_; }

  // Of the stand-in: the controller manager's side.
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_ =
      std::make_shared<rclcpp_lifecycle::LifecycleNode>();
  unsigned update_rate_ = 1000;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;

 protected:
  template <class Value>
  void auto_declare(const std::string& name, const Value& otherwise) {
    node_->parameters.try_emplace(name, rclcpp::Parameter{otherwise});
  }
};

}  // namespace controller_interface
