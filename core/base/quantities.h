#pragma once

#include <Eigen/Core>
#include <limits>

/// Types that every library shares. This header and core/robot/model.h are valid C++17, because the
/// Simbody translation unit includes them.
namespace tachless {

/// Most joints a robot may have. Vectors and matrices reserve space for this many in place:
/// nothing allocates once a run has begun.
inline constexpr int max_joints = 64;
/// Value of a limit that a joint does not have.
inline constexpr double infinity = std::numeric_limits<double>::infinity();

/// One entry per joint.
template <class Scalar>
using VectorOf = Eigen::Matrix<Scalar, Eigen::Dynamic, 1, Eigen::ColMajor, max_joints, 1>;
/// One row and one column per joint, or fewer.
template <class Scalar>
using MatrixOf =
    Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, max_joints, max_joints>;

using Vector = VectorOf<double>;  ///< one number per joint
using Matrix = MatrixOf<double>;  ///< one row and one column of numbers per joint, or fewer

}  // namespace tachless
