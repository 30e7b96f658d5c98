#pragma once

#include <netinet/in.h>

#include <array>
#include <cstdint>
#include <optional>
#include <random>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "base/clock.h"
#include "base/file_descriptor.h"
#include "base/quantities.h"
#include "plant/drivers/franka/fci.h"
#include "robot/model.h"
#include "scenario/scenario.h"

namespace tachless::fci {

/// Events of an emulated motion.
enum class Event {
  external_torque,  ///< acts on `joint` from now on; above the thresholds it is a collision
  user_stop,
  lose_commands,  ///< `count` in a row
  lose_states,    ///< `count` in a row
  close,          ///< the arm ends the connection
  die,            ///< the arm is switched off
  freeze,         ///< the arm sends nothing any more; its connection stays open
  mute_reflex     ///< a reflex, and no answer by TCP from then on
};

/// An event at a time of the motion.
struct Incident {
  std::int64_t at_ms = 0;
  Event event{};
  int count = 0;
  std::size_t joint = 0;
  double torque_Nm = 0;
};

/// Troubles of an emulated arm.
struct Trouble {
  Mode mode = Mode::idle;  ///< mode at the beginning
  std::uint16_t version = fci::version;
  double offset_rad = 0;   ///< distance of joint 1 from the scenario's start
  double friction_Nm = 0;  ///< friction that the arm's compensation leaves, times tanh(100 dq)
  double lost_share = 0;   ///< share of the commands that is lost
  bool refuses_late_stop = false;  ///< StopMove is rejected unless the arm moves
  bool ignores_load = false;       ///< SetLoad is confirmed and has no effect
  std::string urdf{};              ///< URDF that the arm reports; empty: the scenario's
  std::vector<Incident> incidents{};
};

/// Time that an emulated arm leaves for an answer to its state.
enum class Pace {
  /// 0.5 ms after the state, as a maker's answer in libfranka issue 163 says.
  as_the_arm,
  /// The arm's time stands still up to 40 ms until the answer is there. A busy machine then loses
  /// no commands.
  patient
};

/// A Franka arm and its control, for one client at a time of the Franka Control Interface on
/// 127.0.0.1. The arm is the scenario's without gravity and friction, which its control adds,
/// integrated at 10 kHz. A torque that answers a state acts from the next state on. The arm keeps
/// the rules of its maker. Torques change by at most 1 N m in a tick. More than 20 lost commands in
/// a row are a reflex. A position beyond the URDF's range is a reflex, too. The same holds for a
/// speed beyond its limit, which decreases toward the ends of the range. It also holds for a torque
/// beyond the sensors' range, and for an external torque above the client's thresholds.
class EmulatedArm {
 public:
  /// Listens on TCP port 1337.
  /// @throw base::Failure(bad_usage) when the robot has not seven joints or the port is taken
  EmulatedArm(const scenario::Scenario& scenario, Pace pace, Trouble trouble = {});
  EmulatedArm(const EmulatedArm&) = delete;
  EmulatedArm& operator=(const EmulatedArm&) = delete;

  /// Serves one client after the other until `ends` is requested.
  void serve(const std::stop_token& ends);

  // Read these once `serve` has returned.
  [[nodiscard]] Mode mode() const { return state_.mode; }
  [[nodiscard]] int motions() const { return motions_; }
  [[nodiscard]] bool has_client() const;
  [[nodiscard]] double largest_change_Nm() const { return largest_change_; }
  [[nodiscard]] int longest_loss() const { return longest_loss_; }         ///< commands in a row
  [[nodiscard]] double speed() const { return v_.cwiseAbs().maxCoeff(); }  ///< [rad/s]
  [[nodiscard]] double load_kg() const { return state_.load_kg; }
  [[nodiscard]] const Joints& thresholds_Nm() const { return thresholds_; }

 private:
  using Time = base::Clock::time_point;

  void begin_tick(Time now);
  void begin_incidents();
  void take_command_of_tick();
  void move();
  void brake();
  void watch();
  void send_state();
  /// Returns true if an answer to the last state may come.
  [[nodiscard]] bool is_awaiting() const;
  void attend(Time until);
  void take_command();
  void take_client();
  void close_client();
  void take_request();
  void handle(Request request, std::uint32_t id, std::span<const std::byte> payload);
  void connect(std::uint32_t id, std::span<const std::byte> payload);
  void respond(Request request, std::uint32_t id, std::uint8_t status,
               std::span<const std::byte> more = {});
  void begin_motion(std::uint32_t id);
  void reflex(Error error);
  void end_motion(MoveStatus status, Mode mode);

  Pace pace_;
  Trouble trouble_;
  std::string urdf_;     ///< URDF that the arm reports
  robot::Model model_;   ///< without gravity
  robot::Model weight_;  ///< model with gravity
  Vector q_, v_, external_;
  base::FileDescriptor listener_, client_, udp_;
  sockaddr_in client_address_{};  ///< address of the client's UDP port; port 0: not connected
  State state_;
  Joints thresholds_;
  Joints acting_{};                 ///< torque of this tick, which the arm took a tick ago [N m]
  std::optional<Command> command_;  ///< command that answers the present state
  Time told_at_;                    ///< time at which the present state was sent
  bool told_ = false;               ///< the present state was sent while the arm moves
  std::array<bool, 100> window_{};  ///< true: the command came
  std::uint32_t move_id_ = 0;
  std::int64_t moving_ms_ = 0;
  int motions_ = 0, lost_in_a_row_ = 0, longest_loss_ = 0, commands_to_lose_ = 0,
      states_to_lose_ = 0;
  double largest_change_ = 0;
  bool muted_ = false, frozen_ = false, dead_ = false;
  std::mt19937_64 random_{1};
};

}  // namespace tachless::fci
