// A driver with a fault (fault.h), for stopping_test.cpp. Behind it is the emulated arm. With CLOCK
// in the environment it is the clock.

#include <chrono>
#include <thread>

#include "plant/node.h"
#include "plant/plant_model.h"
#include "plant/robot_driver.h"
#include "session/options.h"
#include "session/run_role.h"
#include "tests/system/fault.h"

using namespace tachless;
using system_test::fault_of;
using system_test::note;

namespace {

/// The arm, at rest until it is started.
class Arm {
 public:
  explicit Arm(const scenario::Scenario& scenario)
      : model_(plant::plant_model(scenario)),
        period_s_(scenario.loop.period_s),
        arm_(scenario.plant, scenario.robot.flexible, period_s_, model_) {}

  void start() {
    note("start");
    fault_of("start", true);
  }
  void stop() {
    note("stop");
    fault_of("stop", true);
    arm_.stop();
  }
  plant::ArmState read() { return arm_.read(); }
  void move(const Vector& tau) { arm_.hold(tau, ++ticks_ * period_s_); }
  void rest() { arm_.rest(++ticks_ * period_s_); }
  [[nodiscard]] double period_s() const { return period_s_; }

 private:
  robot::Model model_;
  double period_s_;
  plant::EmulatedRobot arm_;
  double ticks_ = 0;
};

class FaultyDriver final : public plant::RobotDriver {
 public:
  explicit FaultyDriver(const scenario::Scenario& scenario) : arm_(scenario) {}

  [[nodiscard]] bool measures_velocity() const override { return false; }
  void start() override { arm_.start(); }
  plant::ArmState read() override {
    fault_of("read");
    plant::ArmState state = arm_.read();
    const bool told_in_ms = system_test::setting("FAULT") == "time milliseconds";
    if (told_in_ms) state.time_s = 1e3 * now_s();
    return state;
  }
  void hold(const Vector& tau, double /*until_s*/) override {
    fault_of("hold");
    arm_.move(tau);
  }
  void rest(double /*until_s*/) override { arm_.rest(); }
  void stop() override { arm_.stop(); }

 private:
  static double now_s() { return base::seconds_of(base::Clock::now().time_since_epoch()); }

  Arm arm_;
};

class FaultyClock final : public plant::ClockDriver {
 public:
  explicit FaultyClock(const scenario::Scenario& scenario) : arm_(scenario) {}

  [[nodiscard]] bool measures_velocity() const override { return false; }
  void start() override {
    arm_.start();
    started_ = true;
  }
  void stop() override { arm_.stop(); }

 private:
  plant::ArmState exchange(const Vector& tau) override {
    fault_of("exchange");
    if (tau.size() > 0) {
      arm_.move(tau);
    } else if (started_) {
      arm_.rest();
    }
    next_ = std::max(next_ + base::nanoseconds_of(arm_.period_s()), base::Clock::now());
    std::this_thread::sleep_until(next_);
    plant::ArmState state = arm_.read();
    state.time_s = base::seconds_of(next_.time_since_epoch());
    return state;
  }

  Arm arm_;
  base::Clock::time_point next_ = base::Clock::now();
  bool started_ = false;
};

}  // namespace

int main(int argc, char** argv) {
  constexpr auto role = messages::Role::plant;
  return session::run_process(role, argc, argv, [](const session::ProcessOptions& options) {
    return session::run_role(role, options, [](const auto& scenario, auto& link) {
      if (system_test::setting("CLOCK").empty()) {
        FaultyDriver driver(scenario);
        plant::run_driver(scenario, link, driver);
      } else {
        FaultyClock driver(scenario);
        plant::run_driver(scenario, link, driver);
      }
    });
  });
}
