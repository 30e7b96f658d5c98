#pragma once

#include "base/quantities.h"

namespace tachless::robot {

/// Factorises M = L D L' in place: D on the diagonal, unit L below it. The upper triangle is
/// neither read nor written. Eigen's own factorisation may allocate from 32 rows up.
/// @return -1, or the first row whose pivot is not above `tolerance` times its diagonal entry of M.
/// M is then not positive definite, and the factorisation is incomplete.
inline int factorise(Matrix& M, double tolerance = 0) {
  const Eigen::Index n = M.rows();
  const Vector diagonal = M.diagonal();
  Vector u(n);  // L D's column
  for (Eigen::Index j = 0; j < n; ++j) {
    const double pivot = M(j, j);
    if (!(pivot > diagonal[j] * tolerance) || !(pivot > 0)) return static_cast<int>(j);
    const Eigen::Index below = n - j - 1;
    u.tail(below) = M.col(j).tail(below);
    M.col(j).tail(below) /= pivot;
    for (Eigen::Index k = j + 1; k < n; ++k) M.col(k).tail(n - k) -= u.tail(n - k) * M(k, j);
  }
  return -1;
}

/// Replaces x by M^-1 x for a factorised M.
inline void solve_in_place(const Matrix& LD, Vector& x) {
  const Eigen::Index n = LD.rows();
  for (Eigen::Index j = 0; j < n; ++j) x.tail(n - j - 1) -= LD.col(j).tail(n - j - 1) * x[j];
  for (Eigen::Index i = 0; i < n; ++i) x[i] /= LD(i, i);
  for (Eigen::Index i = n - 1; i >= 0; --i) {
    for (Eigen::Index j = i + 1; j < n; ++j) x[i] -= LD(j, i) * x[j];
  }
}

}  // namespace tachless::robot
