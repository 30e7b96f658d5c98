#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

/// A control law for a loop in your own program: it takes positions and returns torques, tick by
/// tick, in your thread. It uses no process, no bus and no clock. This header needs C++17 and the
/// standard library alone.
///
///   tachless::CertifiedLoop loop("arm.yaml");     // certifies, or throws the reason
///   for (std::int64_t tick = 0; running; ++tick) {
///     const auto step = loop.torque(tick, positions());
///     if (!step.ok()) return brake(loop.reason(step));
///     send(step.tau);
///   }
///
/// Positions and torques are in the coordinates of the arm. The scenario's joint_signs,
/// joint_offsets_rad and robot.compensates are applied to them. References are in the coordinates
/// of the URDF. After the constructor no call allocates, locks or throws, except calls that return
/// text. One thread uses an object at a time.
namespace tachless::own_loop {

/// A view of one number per joint: of a std::vector, a std::array, an Eigen vector, or of a pointer
/// and a size.
class Numbers {
 public:
  Numbers() = default;  ///< no numbers
  /// Views `size` numbers from `data` on.
  Numbers(const double* data, std::size_t size) : data_(data), size_(size) {}
  /// Views the numbers of a container, which outlives the view.
  template <class Container, class = decltype(*std::declval<const Container&>().data())>
  Numbers(const Container& all)  // NOLINT(google-explicit-constructor): a view
      : data_(all.data()), size_(static_cast<std::size_t>(all.size())) {}

  [[nodiscard]] const double* data() const { return data_; }           ///< the first number
  [[nodiscard]] std::size_t size() const { return size_; }             ///< number of numbers
  [[nodiscard]] const double* begin() const { return data_; }          ///< for range-based loops
  [[nodiscard]] const double* end() const { return data_ + size_; }    ///< for range-based loops
  double operator[](std::size_t joint) const { return data_[joint]; }  ///< joint counts from 0

 private:
  const double* data_ = nullptr;
  std::size_t size_ = 0;
};

/// A reference at one tick.
struct Reference {
  Numbers position;      ///< [rad; m]
  Numbers velocity;      ///< [rad/s; m/s]
  Numbers acceleration;  ///< [rad/s^2; m/s^2]
  Numbers jerk = {};     ///< empty: 0
  Numbers snap = {};     ///< empty: 0
};

/// Bounds of the references that the caller will give. A list has one entry per joint, or one entry
/// for all joints.
struct ReferenceBounds {
  std::vector<double> speed;         ///< largest |v_ref| [rad/s; m/s]
  std::vector<double> acceleration;  ///< largest |a_ref| [rad/s^2; m/s^2]
  std::vector<double> lower = {};    ///< least position [rad; m]; empty: the URDF's
  std::vector<double> upper = {};    ///< largest position [rad; m]; empty: the URDF's
};

/// A robot and a law's gains, in place of a scenario's file.
struct LawSettings {
  std::string urdf;                                  ///< path of the robot's file
  std::map<std::string, std::vector<double>> gains;  ///< "kp" -> one number per joint
  double period_s = 1e-3;                            ///< one tick [s]
  int command_delay = 1;  ///< ticks from a reading to the tick over which its torque acts
  /// A law of `tachless laws` that measures positions alone.
  std::string law = "loria_ortega_rigid";
};

/// Result of a step.
enum class Status {
  ok,
  beyond_bounds,  ///< the torque is the law's; the reference is beyond the certified bounds
  // The statuses below give no new torque: `Step::tau` is the last one.
  old_tick,      ///< the tick is not later than the last one
  wrong_size,    ///< the number of positions or references is not the number of joints
  no_reference,  ///< the scenario has none, and the caller gave none
  not_finite,  ///< a position or reference is no number or above 1e12, or the torque is not finite
  out_of_range,   ///< guards: a joint is outside its range in the URDF
  too_fast,       ///< guards: a joint is above its speed limit in the URDF
  off_reference,  ///< guards: a joint is farther from its reference than plant.following_error_rad
};

/// One step. Its views are valid until the next call of the object that returned it.
struct [[nodiscard]] Step {
  Status status = Status::ok;  ///< result of the step
  int joint = -1;              ///< joint of the status, counted from 0; -1: none
  std::int64_t tick = 0;       ///< tick of the call
  std::int64_t skipped = 0;    ///< ticks without a step before this one: the law stepped over them
  bool restarted = false;      ///< the gap was too long, and the law's memory started again
  bool saturated = false;      ///< guards: a torque was limited
  Numbers tau;                 ///< torque to send [N m; N]
  Numbers law_tau;             ///< whole torque of the law, as a log's COMMAND [N m; N]
  Numbers arm_tau;             ///< torque that the arm adds itself (robot.compensates) [N m; N]
  Numbers position;            ///< q in the coordinates of the URDF [rad; m]
  Numbers desired;             ///< q_ref [rad; m]

  /// Returns true if the torque belongs to this step, within the bounds of a certified loop.
  [[nodiscard]] bool ok() const { return status == Status::ok; }
  /// Returns true if the torque is of this step: ok, or beyond the bounds.
  [[nodiscard]] bool has_torque() const { return ok() || status == Status::beyond_bounds; }
};

/// A law without a certificate. `CertifiedLoop` adds the certificate.
class Loop {
 public:
  /// Reads a scenario. `reference`, `plant` and `loop.duration_s` may be missing.
  /// @param set "key=value" of the scenario, as for --set: "loop.period_s=0.002"
  /// @throw std::runtime_error if the scenario is refused; one line names file, line, key, value
  /// and the allowed values
  explicit Loop(const std::string& scenario_file, const std::vector<std::string>& set = {});
  /// Makes the law of a robot. Other settings have the values that `tachless design` writes for a
  /// URDF alone.
  explicit Loop(const LawSettings& law, const std::vector<std::string>& set = {});
  Loop(Loop&&) noexcept;             ///< a loop moves and is not copied
  Loop& operator=(Loop&&) noexcept;  ///< a loop moves and is not copied
  ~Loop();

  /// Returns the torque for the positions of `tick` along the scenario's reference. Ticks begin at
  /// 0 and increase. Leave out a tick whose reading is missing.
  Step torque(std::int64_t tick, Numbers position) noexcept;
  /// Returns the torque for the caller's reference.
  Step torque(std::int64_t tick, Numbers position, const Reference& reference) noexcept;
  /// Begins a new run: the law's memory is initialised again, and ticks begin at 0.
  void reset() noexcept;

  /// Returns the scenario's reference at a tick, valid until the next call; empty without one.
  [[nodiscard]] Reference planned(std::int64_t tick) noexcept;
  /// Returns why a step is not ok, in one line with a remedy.
  [[nodiscard]] std::string reason(const Step& step) const;

  [[nodiscard]] double period_s() const noexcept;                         ///< one tick [s]
  [[nodiscard]] const std::vector<std::string>& joints() const noexcept;  ///< names, in order
  [[nodiscard]] bool has_reference() const noexcept;  ///< the scenario gives one

 protected:
  friend class Guards;
  struct Impl;
  std::shared_ptr<Impl> impl_;  ///< law, memory and scenario
};

/// Error of a loop without a certificate: it is unstable, or its law cannot be linearised.
struct NotCertified : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Certificate of the sampled loop, linearised (docs/certificate.md).
struct Certificate {
  std::string text;    ///< "stable at 1 kHz with 1 tick of delay: limit 3.6 ms, …"
  double limit_s = 0;  ///< largest stable period [s]
  /// Longest time in which a position error that begins at rest falls to 1 % [s].
  double settling_s = 0;
  std::vector<double> stiffness;  ///< torque per position error at rest, the least [N m/rad; N/m]
};

/// A law whose loop was certified at its period and delay: along the scenario's reference, within
/// the bounds of the caller's references, or both. The bounds are checked at each step. The change
/// since the last reference is checked too. Link the target tachless::certified_loop.
class CertifiedLoop : public Loop {
 public:
  /// Certifies the loop along the scenario's reference.
  /// @throw NotCertified if the loop is unstable or its law cannot be linearised
  /// @throw std::runtime_error as `Loop`, and if the scenario has no reference
  explicit CertifiedLoop(const std::string& scenario_file,
                         const std::vector<std::string>& set = {});
  /// Certifies the loop within the bounds, and along the scenario's reference if there is one.
  CertifiedLoop(const std::string& scenario_file, const ReferenceBounds& bounds,
                const std::vector<std::string>& set = {});
  /// Certifies the law of a robot's file within the bounds.
  CertifiedLoop(const LawSettings& law, const ReferenceBounds& bounds,
                const std::vector<std::string>& set = {});

  /// Returns what the constructor certified.
  [[nodiscard]] const Certificate& certificate() const noexcept { return certificate_; }

 private:
  void certify(const ReferenceBounds* bounds);
  Certificate certificate_;
};

/// Guards of an arm: range and speed of each joint, the following error, torque and its rate.
/// `tachless run --plant` has the same guards. The first broken guard holds until `reset`.
class Guards {
 public:
  /// Takes the limits of the loop's URDF and scenario.
  /// @throw std::runtime_error if a joint has no torque limit
  explicit Guards(const Loop& loop);
  Guards(Guards&&) noexcept;             ///< guards move and are not copied
  Guards& operator=(Guards&&) noexcept;  ///< guards move and are not copied
  ~Guards();

  /// Returns the step with its torque limited, or with the status of a broken guard.
  Step check(const Step& step) noexcept;
  /// Begins a new run.
  void reset() noexcept;
  /// Returns why a step that `check` returned is not ok, in one line with a remedy.
  [[nodiscard]] std::string reason(const Step& step) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tachless::own_loop

namespace tachless {

using own_loop::CertifiedLoop;
using own_loop::Guards;

}  // namespace tachless
