#pragma once

#include <ur_client_library/ur/ur_driver.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "base/schema.h"
#include "plant/robot_driver.h"
#include "scenario/scenario.h"

namespace tachless::ur {

/// Payload that the arm adds gravity for, `plant.driver.payload`.
struct Payload {
  std::optional<double> mass_kg;
  std::vector<double> center_m = {0, 0, 0};

  static constexpr std::tuple keys{
      base::Key{"mass_kg", &Payload::mass_kg, "kg", "Mass at the flange"}.in({0, 50}).by_default(
          "the arm's installation"),
      base::Key{"center_m", &Payload::center_m, "m", "Its centre of mass in the flange's frame"}
          .by_default()};

  [[nodiscard]] std::optional<base::Refusal> refusal() const;
};

/// `plant.driver` of this driver.
struct Settings {
  std::string address;
  std::string script;
  bool headless = true;
  std::string reverse_address;
  double command_timeout_s = 0.02;
  double start_wait_s = 30;
  Payload payload;

  static constexpr std::tuple keys{
      base::Key{"address", &Settings::address, "", "Name or IP address of the arm's controller"},
      base::Key{"script", &Settings::script, "",
                "File external_control.urscript, which the maker's library installs"},
      base::Key{"headless", &Settings::headless, "",
                "Sends the program to an arm in remote control; false: the program node External "
                "Control of the pendant fetches it"}
          .by_default(),
      base::Key{"reverse_address", &Settings::reverse_address, "",
                "Address of this computer for the arm"}
          .by_default("found by the library"),
      base::Key{"command_timeout_s", &Settings::command_timeout_s, "s",
                "The arm brakes when no torque has come for so long; a whole number of ms"}
          .in({0.002, 0.2})
          .by_default(),
      base::Key{"start_wait_s", &Settings::start_wait_s, "s",
                "Longest wait for the program to start on the arm"}
          .in(base::positive)
          .by_default(),
      base::Key{"payload", &Settings::payload}};
};

/// An arm of Universal Robots by the maker's client library (docs/drivers/ur.md). The arm is the
/// clock: 500 Hz. The driver sends torques by `direct_torque`, and the arm adds gravity to them.
/// The driver sets the arm's own compensation of friction to zero, because no model contains it.
class UrDriver final : public plant::ClockDriver {
 public:
  /// Connects, checks the arm's version, and waits until its program runs.
  /// @throw base::Failure(bad_usage) naming address, cause and remedy
  explicit UrDriver(const scenario::Scenario& scenario);
  UrDriver(const UrDriver&) = delete;
  UrDriver& operator=(const UrDriver&) = delete;
  ~UrDriver() override = default;

  /// Returns true: the arm reports joint velocities. The maker does not publish their filter.
  [[nodiscard]] bool measures_velocity() const override { return true; }
  void start() override;
  void stop() override;
  [[nodiscard]] std::vector<plant::DriverFigure> figures() const override;

 private:
  void require_version() const;
  void wait_for_program();
  plant::ArmState exchange(const Vector& tau) override;
  void update();
  /// @throw base::Failure(protective_stop) when the arm's safety or the end of its program has
  /// stopped it
  void require_running();
  [[nodiscard]] base::Failure refused(std::string_view problem) const;

  Settings settings_;
  std::atomic<bool> program_runs_ = false;  ///< set by a thread of the library
  std::unique_ptr<urcl::UrDriver> arm_;
  std::unique_ptr<urcl::rtde_interface::DataPackage> package_;
  plant::ArmState now_;
  std::int32_t safety_ = 1;
  bool running_ = false;  ///< the arm takes torques
  bool lost_ = false;     ///< no state comes any more
  std::int64_t sent_ = 0;
};

}  // namespace tachless::ur
