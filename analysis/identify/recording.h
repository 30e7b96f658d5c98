#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "logger/run_log.h"
#include "scenario/scenario.h"

/// Identification of a rigid robot's parameters from logs of its own runs. It uses measured
/// positions and applied torques. It needs no measured velocity and does not read an emulator's
/// true state.
namespace tachless::identify {

/// Torques of a log. An arm may tell the torque that it `accepted` and the one that it `measured`
/// by its motors' currents. A torque `behind_gear` is measured by sensors between gear and link: it
/// has no rotor inertia and none of the friction before the sensor in it.
enum class TorqueSource { commanded, accepted, measured, behind_gear };
constexpr std::array<std::string_view, 4> names(TorqueSource /*type*/) {
  return {"commanded", "accepted", "measured", "behind_gear"};
}

/// The data of a run that identification reads.
struct Recording {
  std::string source;  ///< path of the log
  scenario::Scenario scenario;
  Eigen::MatrixXd q;    ///< measured positions [rad; m], a row per tick
  Eigen::MatrixXd tau;  ///< applied over the tick [N m; N], a row per tick
  /// True if the scenario's law controlled the run, with torques held over each tick. The run
  /// can then be simulated. Otherwise torques and positions are of the same instant.
  bool controlled = true;
  /// Ticks by which the torques of a table have been moved: row k holds the torque that the table
  /// has `moved` rows earlier, interpolated if this is no whole number.
  double moved = 0;
  bool loaded = true;       ///< the arm carried the load that is to be identified
  std::int64_t missed = 0;  ///< ticks without a reading, which were filled, or without a command
  /// Part of `tau` that the arm adds itself (robot.compensates) [N m; N]. It acts at once, while
  /// the rest may act late. Empty: there is none.
  Eigen::MatrixXd own{};
  /// Ticks from a position until the part of `own` of that position acts, in the mean. Nothing
  /// tells it more exactly than from 0 to twice this number.
  double own_late = 0;

  [[nodiscard]] Eigen::Index num_ticks() const { return q.rows(); }
};

/// Positions and torques of a log, in the form of a Recording.
struct Ticks {
  Eigen::MatrixXd q, tau;
  /// Ticks without a command; ticks with a torque at its limit.
  std::int64_t missed = 0, saturated = 0;
  std::vector<std::int64_t> tick;  ///< of each row
  bool of_driver = true;           ///< the state of the arm is what was read, as a driver logs it
};

/// Rows of all ticks from the first to the last one of a log.
struct FilledTicks {
  Eigen::MatrixXd q, tau;
  std::int64_t missing = 0;  ///< ticks that the log does not have
  std::int64_t longest = 0;  ///< largest number of them in a row
};

/// Fills the rows of missing ticks. Their positions are interpolated, and their torques are those
/// before.
FilledTicks fill(const Ticks& ticks);

/// A matrix that grows by a row for each tick.
class TickRows {
 public:
  void add(const Vector& row) { numbers_.insert(numbers_.end(), row.begin(), row.end()); }
  /// Returns the rows so far as a matrix of `columns` columns.
  [[nodiscard]] Eigen::MatrixXd matrix(Eigen::Index columns) const;

 private:
  std::vector<double> numbers_;
};

/// Computes the torque that the arm of the scenario adds itself, from the recorded positions.
/// @param of_log a tick of the recording is one of the loop. An arm's controller that runs at the
/// loop's rate holds the torque over each tick, in the mean half a tick late. A faster one follows
/// the position. The middle is taken: a quarter tick. The torque of a table follows the position.
void set_own_torque(Recording& recording, bool of_log);

/// Reads positions and torques from a log.
/// @param to_stop whether to leave out the ticks from a protective stop on
/// @throw base::Failure(bad_usage) when positions of the joints are not recorded, or the arm
/// reported no such torque
Ticks read_ticks(logger::RunLog& log, bool to_stop = false,
                 TorqueSource source = TorqueSource::commanded);

/// Reads a recording from a log. With torques that the arm told, the recording is of no known law
/// (`controlled` is false). With torques behind the gear, its scenario has no rotors and no
/// friction. A law steps over missed ticks as no simulation knows, so `controlled` is false with
/// them, too. Positions of missing ticks are interpolated, and their torques are those before.
/// @throw base::Failure(bad_usage), one line, if the robot has flexible joints
/// @throw base::Failure(bad_usage), one line, if positions are not recorded, or more than 20 % of
/// the ticks are missed, or 20 ms in a row are missing
/// @throw base::Failure(bad_usage), one line, for a dry run, withheld torques, changing gains, a
/// torque at its limit in more than 1 % of the ticks, less than 2 s, or no joint that moves
Recording read_recording(const std::filesystem::path& log,
                         TorqueSource source = TorqueSource::commanded);

/// Reads a recording from another logger's table. The YAML file `description` names the table's
/// columns (docs/identification.md). Interpolates on an even grid whose step is the median step of
/// the table.
/// @throw base::Failure(bad_usage) with one line: file, line, fault and allowed values
Recording read_table(const std::filesystem::path& description);

/// Returns the torques of a recording without those that the arm adds itself.
Eigen::MatrixXd sent_torque(const Recording& recording);

/// Returns a table's recording with its torques moved by so many ticks, except those that the arm
/// adds itself. Torques between two rows are interpolated linearly. Rows without a torque are left
/// out.
/// @param recording a table whose torques have not been moved
Recording with_torques_moved(const Recording& recording, double ticks);

/// Checks the length and motion of a recording.
/// @throw base::Failure(bad_usage) for less than 2 s, or when no joint moves
void require_usable(const Recording& recording);

/// Checks that both recordings are of the same robot.
/// @throw base::Failure(bad_usage) when URDF, locked joints, base or gravity differ
void require_same_robot(const Recording& first, const Recording& other);

}  // namespace tachless::identify
