// A robot driver instead of the simulated plant: docs/real_robot.md. `RigDriver` holds the code for
// a specific robot.

#include <chrono>
#include <memory>

#include <tachless/plant/node.h>
#include <tachless/plant/plant_model.h>
#include <tachless/plant/robot_driver.h>
#include "rig.h"

using namespace tachless;

namespace {

class RigDriver final : public plant::RobotDriver {
 public:
  explicit RigDriver(const robot::Model& model) : rig_(model) {}

  // The rig has encoders but no tachometers.
  [[nodiscard]] bool measures_velocity() const override { return false; }

  void start() override { rig_.enable(); }

  plant::ArmState read() override {
    if (rig_.watchdog_has_tripped()) {
      throw base::Failure(base::ExitCode::protective_stop,
                          "the rig's drives had no torque for 500 ms and have braked");
    }
    const auto now = std::chrono::steady_clock::now();
    plant::ArmState state;
    state.q = rig_.read_encoders();
    // This state is for the log; no law receives it.
    const double passed_s = std::chrono::duration<double>(now - read_at_).count();
    state.v = Vector::Zero(state.q.size());
    if (last_q_.size() != 0) state.v = (state.q - last_q_) / passed_s;
    last_q_ = state.q;
    read_at_ = now;
    return state;
  }

  void hold(const Vector& tau, double /*until_s*/) override { rig_.write_torque(tau); }

  void stop() override { rig_.brake(); }

 private:
  own_driver::Rig rig_;
  Vector last_q_;
  std::chrono::steady_clock::time_point read_at_;
};

}  // namespace

int main(int argc, char** argv) {
  return plant::driver_program(argc, argv, [](const scenario::Scenario& scenario) {
    return std::make_unique<RigDriver>(plant::plant_model(scenario));
  });
}
