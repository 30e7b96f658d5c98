// Plays the controller manager for the plugin of examples/ros2_control, twice: both instances, and
// the same plugin under another name, live in one process. Arguments: PLUGIN OTHER_PLUGIN SCENARIO
#include <dlfcn.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <string>

#include <controller_interface/controller_interface.hpp>

using controller_interface::CallbackReturn;
using controller_interface::ControllerInterface;
using controller_interface::return_type;

namespace {

int failures = 0;

void check(bool holds, const char* what) {
  if (holds) return;
  std::printf("not so: %s\n", what);
  ++failures;
}

std::unique_ptr<ControllerInterface> loaded(const char* plugin) {
  void* library = dlopen(plugin, RTLD_NOW | RTLD_GLOBAL);
  if (library == nullptr) {
    std::printf("%s\n", dlerror());
    return nullptr;
  }
  auto* make = reinterpret_cast<ControllerInterface* (*)()>(dlsym(library, "new_controller"));
  return std::unique_ptr<ControllerInterface>(make());
}

CallbackReturn configured(ControllerInterface& controller, const std::string& scenario) {
  auto& parameters = controller.get_node()->parameters;
  parameters["scenario"].value = scenario;
  parameters["joints"].value = std::vector<std::string>{"shoulder", "elbow"};
  return controller.on_configure({});
}

/// Returns the torques of ticks with a missing reading among them.
std::vector<double> torques(ControllerInterface& controller) {
  controller.state_interfaces_.assign(2, {0.0});
  controller.command_interfaces_.assign(2, {});
  check(controller.on_activate({}) == CallbackReturn::SUCCESS, "on_activate succeeds");
  std::vector<double> all;
  for (int tick = 0; tick < 20; ++tick) {
    controller.state_interfaces_[0].value = 1e-3 * tick;
    controller.state_interfaces_[1].value = tick % 7 == 3 ? std::nullopt : std::optional(0.0);
    check(controller.update({}, {}) == return_type::OK, "update succeeds");
    for (const auto& each : controller.command_interfaces_) all.push_back(each.value);
  }
  return all;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  const auto one = loaded(argv[1]), other = loaded(argv[2]);
  if (one == nullptr || other == nullptr) return 1;
  const std::string scenario = argv[3];
  for (const auto& each : {one.get(), other.get()}) {
    check(each->on_init() == CallbackReturn::SUCCESS, "on_init succeeds");
    check(configured(*each, scenario) == CallbackReturn::SUCCESS, "a stable scenario is accepted");
    check(each->state_interface_configuration().names ==
              std::vector<std::string>{"shoulder/position", "elbow/position"},
          "positions are the only state");
  }
  const auto first = torques(*one);
  check(first == torques(*one), "an activation begins anew");
  check(first == torques(*other), "the other plugin commands the same");
  check(std::abs(first.back()) > 1e-3, "there is a torque");

  one->state_interfaces_[0].value = std::nan("");
  check(one->update({}, {}) == return_type::ERROR, "a position that is not finite is an error");
  std::printf("%s\n", one->get_node()->logger.last.c_str());

  one->update_rate_ = 500;
  check(configured(*one, scenario) == CallbackReturn::ERROR, "another rate is refused");
  std::printf("%s\n", one->get_node()->logger.last.c_str());
  check(configured(*one, "nowhere.yaml") == CallbackReturn::ERROR, "a missing file is refused");
  return failures == 0 ? 0 : 1;
}
