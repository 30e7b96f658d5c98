#pragma once

#include <optional>

#include "linear/sampled_limit.h"

/// The number of ticks in a row that a sampled loop may miss in any pattern of hits and misses. It
/// is computed by the linearisation with the torque held. The property is weakly hard real-time in
/// Bernat's sense, "at most m in any m + 1".
///
/// A **missed command** is lost or late: the torque of the tick before acts in its place. After p
/// misses the torque differs from the law's torque by the sum of the law's last p increments u_k -
/// u_{k-1}. Over m misses this is a triangular matrix of ones, of norm
///   gamma_u(m) = 1 / (2 sin(pi / (4 m + 2))).
/// A **missed measurement** also leaves out the law's step. The law makes up for the step along the
/// straight line to the next measurement (controller/any_law.h). In a gap of m ticks the law gets
/// the positions plus an error that is zero at both ends. The second differences of this error are
/// the negated second differences of the positions. The map from these differences to the error is
/// the inverse of the discrete Laplacian, of norm
///   gamma_y(m) = 1 / (4 sin²(pi / (2 (m + 1)))).
/// Both operators are the same for all joints, so they commute with any constant matrix. The
/// small-gain theorem (Zames, 1966) on the loop between them and the rest then holds with any
/// scaling. The loop is stable if gamma_u |G_u| < 1. With missed measurements too, it is stable if
/// the spectral radius of the 2 x 2 matrix of the gains between both operators is below 1. |G| is
/// the largest singular value over all frequencies. The supremum is searched, not bounded: the
/// numbers are searched, not proved.
namespace tachless::linear {

/// Largest numbers in a row, up to `most_missed`.
struct MissedTicks {
  int commands = 0;  ///< the loop is stable for each pattern with at most this many in a row
  /// Largest number of measurements in a row; nothing for a law that measures velocities.
  std::optional<int> measurements;
  std::optional<int> unstable;  ///< fewest commands in a row of an unstable pattern that was found
  int hits = 0;  ///< commands that arrive after the missed ones in that pattern, which is repeated
};
inline constexpr int most_missed = 1000;

/// Return gamma_u and gamma_y for this number of missed ticks in a row.
double gain_of_missed_commands(int in_a_row);
double gain_of_missed_measurements(int in_a_row);

/// The maps of one period in which the command arrives (`hit`), and in which it is missed. Their
/// state is the state of `cut` followed by the last torque.
struct HeldMaps {
  Eigen::MatrixXd hit, missed;
};
/// Returns the maps of a loop.
HeldMaps held_maps(const SampledLoop& loop, double period_s);

/// Returns the number of ticks in a row that a stable loop may miss.
MissedTicks missed_ticks(const SampledLoop& loop, double period_s);

/// Finds the fewest missed commands in a row that make the loop unstable, above `commands`. A
/// pattern is a number of misses and 1 to 4 hits, repeated. Sets `unstable` and `hits`.
void find_unstable_pattern(const SampledLoop& loop, double period_s, MissedTicks& result);

}  // namespace tachless::linear
