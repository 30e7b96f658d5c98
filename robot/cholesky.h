#pragma once

#include "robot/quantities.h"

namespace tachless::robot {

/// M = L D L' in place: D on the diagonal, unit L below it; the upper triangle is neither read nor
/// written. Eigen's own factorisation knows no jets and may allocate from 32 rows up.
/// @return -1, or the first row whose pivot is not above `tolerance` times its diagonal entry of
/// M: M is not positive definite, and the rest is left half done.
template <class Scalar>
int factorise(MatrixOf<Scalar>& M, double tolerance = 0) {
  const Eigen::Index n = M.rows();
  for (Eigen::Index i = 0; i < n; ++i) {
    Scalar pivot = M(i, i);
    for (Eigen::Index j = 0; j < i; ++j) {
      Scalar u = M(i, j);  // L(i,j) D(j)
      for (Eigen::Index k = 0; k < j; ++k) u -= M(i, k) * M(j, k);
      M(i, j) = u;
    }
    const Scalar diagonal = pivot;
    for (Eigen::Index j = 0; j < i; ++j) {
      const Scalar l = M(i, j) / M(j, j);
      pivot -= l * M(i, j);
      M(i, j) = l;
    }
    if (!(pivot > diagonal * tolerance) || !(pivot > Scalar(0))) return static_cast<int>(i);
    M(i, i) = pivot;
  }
  return -1;
}

/// x := M^-1 x for a factorised M.
template <class Scalar>
void solve_in_place(const MatrixOf<Scalar>& LD, VectorOf<Scalar>& x) {
  const Eigen::Index n = LD.rows();
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < i; ++j) x[i] -= LD(i, j) * x[j];
  }
  for (Eigen::Index i = 0; i < n; ++i) x[i] /= LD(i, i);
  for (Eigen::Index i = n - 1; i >= 0; --i) {
    for (Eigen::Index j = i + 1; j < n; ++j) x[i] -= LD(j, i) * x[j];
  }
}

}  // namespace tachless::robot
