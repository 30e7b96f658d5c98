#pragma once

#include "robot/quantities.h"
#include "robot/triple.h"

namespace tachless::robot {

/// M = L D L' in place: D on the diagonal, unit L below it; the upper triangle is neither read nor
/// written. Eigen's own factorisation knows no jets and may allocate from 32 rows up.
/// @return -1, or the first row whose pivot is not above `tolerance` times its diagonal entry of
/// M: M is not positive definite, and the rest is left half done.
template <class Scalar>
int factorise(MatrixOf<Scalar>& M, double tolerance = 0) {
  const Eigen::Index n = M.rows();
  Scalar diagonal[max_joints], u[max_joints];  // of M; L D's column
  for (Eigen::Index i = 0; i < n; ++i) diagonal[i] = M(i, i);
  for (Eigen::Index j = 0; j < n; ++j) {
    const Scalar pivot = M(j, j);
    if (!(pivot > diagonal[j] * tolerance) || !(pivot > Scalar(0))) return static_cast<int>(j);
    Scalar* column = &M(0, j);
    for (Eigen::Index i = j + 1; i < n; ++i) {
      u[i] = column[i];
      column[i] = u[i] / pivot;
    }
    for (Eigen::Index k = j + 1; k < n; ++k) {
      const Scalar l = column[k];
      M(k, k) -= l * u[k];
      subtract_scaled(&M(0, k) + k + 1, u + k + 1, l, n - k - 1);
    }
  }
  return -1;
}

/// x := M^-1 x for a factorised M.
template <class Scalar>
void solve_in_place(const MatrixOf<Scalar>& LD, VectorOf<Scalar>& x) {
  const Eigen::Index n = LD.rows();
  for (Eigen::Index j = 0; j < n; ++j) {
    subtract_scaled(x.data() + j + 1, &LD(0, j) + j + 1, x[j], n - j - 1);
  }
  for (Eigen::Index i = 0; i < n; ++i) x[i] /= LD(i, i);
  for (Eigen::Index i = n - 1; i >= 0; --i) {
    Scalar y = x[i];
    for (Eigen::Index j = i + 1; j < n; ++j) y -= LD(j, i) * x[j];
    x[i] = y;
  }
}

}  // namespace tachless::robot
