#pragma once

#include <optional>

#include "linear/sampled_limit.h"

/// How many ticks in a row a sampled loop may miss, whatever the pattern of hits and misses: its
/// linearisation, torque held. Weakly hard real-time in Bernat's sense, "at most m in any m + 1".
///
/// A **missed command** is lost or late: the torque of the tick before counts for it. After p
/// misses the torque differs from the law's by the sum of its last p increments u_k - u_{k-1}; over
/// m misses that is a triangular matrix of ones, of norm
///   gamma_u(m) = 1 / (2 sin(pi / (4 m + 2))).
/// A **missed measurement** leaves the law without its step as well, which it makes up for along
/// the straight line to the next measurement (controller/any_law.h): in a gap of m ticks it is
/// given the positions plus an error whose second differences are those of the positions, negated,
/// and which is zero at both ends: the inverse of the discrete Laplacian, of norm
///   gamma_y(m) = 1 / (4 sin²(pi / (2 (m + 1)))).
/// Both operators are the same for all joints, so that they commute with any constant matrix. The
/// small-gain theorem (Zames, 1966) on the loop between them and the rest then holds with any
/// scaling. The loop is stable where gamma_u |G_u| < 1. It is also stable where the spectral radius
/// of the matrix of the four gains of both is below 1. |G| is the largest singular value over all
/// frequencies. The supremum is searched, not bounded: the numbers are searched, not proved.
namespace tachless::linear {

/// Largest numbers in a row, up to `most_missed`.
struct MissedTicks {
  int commands = 0;                 ///< found stable for every pattern with at most so many
  std::optional<int> measurements;  ///< the same; nothing for a law that measures velocities
  std::optional<int> unstable;  ///< fewest commands in a row of an unstable pattern that was found
  int hits = 0;                 ///< that follow them in it, again and again
};
inline constexpr int most_missed = 1000;

double gain_of_missed_commands(int in_a_row);
double gain_of_missed_measurements(int in_a_row);

/// The map of one period in which the command is missed, of a state with the last torque beside
/// that of `cut`, and the map of one in which it is not.
struct HeldMaps {
  Eigen::MatrixXd hit, missed;
};
HeldMaps held_maps(const SampledLoop& loop, double period_s);

/// Returns how many ticks in a row a stable loop may miss.
MissedTicks missed_ticks(const SampledLoop& loop, double period_s);

/// Fewest commands in a row, in patterns of so many misses and 1 to 4 hits, repeated, that make it
/// unstable; looked for above `commands`. Sets `unstable` and `hits`.
void find_unstable_pattern(const SampledLoop& loop, double period_s, MissedTicks& result);

}  // namespace tachless::linear
