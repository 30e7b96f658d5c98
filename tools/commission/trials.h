#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "commission/commission.h"
#include "robot/model.h"

namespace tachless::commission {

/// Returns the speed that no joint of an unknown arm may exceed: a tenth of its limit, or 0.1 where
/// the URDF has no limit [rad/s; m/s].
Vector careful_speed(const robot::Model& model);

/// Returns the numbers as a list of YAML. They read back as the same numbers.
inline std::string list(const Vector& values) {
  return fmt::format("[{}]", fmt::join(values, ", "));
}

inline constexpr double most_missed_share = 0.05;  ///< of the ticks of a trial that tells anything
inline constexpr int longest_delay = 6;            ///< [ticks] beyond the loop's own
inline constexpr double answer_counts = 10;        ///< least motion that is an answer [counts]
/// Largest deflection of the references, and of a joint from its reference [rad; m].
inline constexpr double reach = 0.016, farthest = 0.02;
/// Deflection of a joint that ends the pulses of another one [rad; m].
inline constexpr double aside = 5e-3;

/// A soft law.
struct SoftLaw {
  Vector kp, kd;
  double gravity_share = 0;  ///< sent share of gravity's torque; 0: the arm adds gravity
  Vector rotor = {};  ///< inertia that the feed-forward assumes [kg m^2; kg]; empty: the scenario's
};

/// Pulses of torque on one joint without feedback. Each pulse has twice the torque of the pulse
/// before, in the opposite direction. The reference moves by `largest` in the last one: the law
/// believes in a rotor that needs the torque for it.
struct Pulses {
  Eigen::Index joint = 0;
  double largest = 0;  ///< [rad; m]
  int count = 1;
  double reach = 0;  ///< deflection that ends the trial [rad; m]
};

/// Runs trials on an arm, one after the other. Each trial begins where the arm is. The guards of
/// the plant stop a trial at a tenth of a speed limit and `farthest` from the reference.
class ArmRuns {
 public:
  ArmRuns(const scenario::Scenario& scenario, const Trials& trials);

  /// Returns the scenario with the signs that were found so far, at the arm's position.
  [[nodiscard]] const scenario::Scenario& scenario() const { return at_; }
  /// Returns the pole of a soft law [1/s], for a delay of `longest_delay` beyond the loop's own.
  [[nodiscard]] double rate() const;
  [[nodiscard]] double period_s() const { return scenario_.loop.period_s; }
  [[nodiscard]] const Vector& speed() const { return speed_; }  ///< largest speed [rad/s; m/s]
  [[nodiscard]] const Vector& count() const { return count_; }  ///< of an encoder [rad; m]
  [[nodiscard]] const Vector& turned_by() const { return turned_by_; }  ///< signs found so far

  [[nodiscard]] const Vector& position() const { return last_; }  ///< of the arm [rad; m]

  /// Turns the joints with a negative entry against the scenario.
  void turn(const Vector& signs);

  /// Runs a moment with a share of gravity's torque and no feedback.
  /// @param reach largest deflection of each joint [rad; m]
  Trial still(double gravity_share, const Vector& reach, double duration_s);
  /// Runs sines about the arm's position, each from rest.
  /// @param amplitude, frequency_hz of each joint, a vector for each sine [rad; m]
  /// @param withheld see plant.withheld_ticks
  Trial sines(const SoftLaw& law, const std::vector<Vector>& amplitude,
              const std::vector<Vector>& frequency_hz, double duration_s, int withheld = 0);

  Trial pulses(const SoftLaw& law, const Pulses& pulses);
  static constexpr double pulse_s = 0.12;
  static constexpr double no_gain = 1e-9;  ///< instead of no feedback, which the law refuses

  double seconds = 0;       ///< arm time of all trials
  std::int64_t missed = 0;  ///< commands that did not arrive
  int repeated = 0;         ///< trials that were run again
  bool arm_is_clock = false;

 private:
  std::optional<Trial> run(const SoftLaw& law, const std::string& reference, const Vector& reach,
                           double duration_s, std::vector<std::string> changes = {});
  /// Returns where the arm began, in the coordinates of the present signs.
  [[nodiscard]] Vector began() const;
  /// Finds where the arm is, once it rests, by runs that send nothing.
  void look();
  std::optional<Trial> carry_out(const std::vector<std::string>& changes);
  /// Carries out a run from where the arm is. Repeats it if ticks were late or are missing.
  /// @param run makes its settings by `last_`, and carries it out
  Trial from_here(const std::function<std::optional<Trial>()>& run);
  /// Calls `run` until it returns a trial.
  /// @throw base::Failure(check_said_no) if it returns nothing more than `most_repeats` times
  Trial until_done(const std::function<std::optional<Trial>()>& run);

  const scenario::Scenario& scenario_;
  const Trials& trials_;
  scenario::Scenario at_;
  Vector speed_, count_, turned_by_;
  Vector last_;        ///< position of the arm at the end of the last trial
  bool moves_ = true;  ///< the arm may have moved since then
  bool sags_ = false;  ///< the arm moves between trials: it has no brakes
};

}  // namespace tachless::commission
