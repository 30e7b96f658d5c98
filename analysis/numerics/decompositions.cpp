#include "numerics/decompositions.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>

namespace tachless::numerics {

using Eigen::MatrixXcd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

Eigen::VectorXcd eigenvalues(const MatrixXd& A) {
  return Eigen::EigenSolver<MatrixXd>(A, false).eigenvalues();
}

VectorXd symmetric_eigenvalues(const MatrixXd& A) {
  return Eigen::SelfAdjointEigenSolver<MatrixXd>(A, Eigen::EigenvaluesOnly).eigenvalues();
}

double spectral_norm(const MatrixXd& A) {
  return std::sqrt(std::max(0.0, largest_eigenvalue(A.transpose() * A)));
}

double smallest_eigenvalue(const MatrixXd& symmetric) {
  return symmetric_eigenvalues(symmetric)[0];
}

double largest_eigenvalue(const MatrixXd& symmetric) { return -smallest_eigenvalue(-symmetric); }

SymmetricEigen symmetric_eigen(const MatrixXd& A) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

VectorXd singular_values(const MatrixXd& A) { return A.jacobiSvd().singularValues(); }

Singular singular(const MatrixXd& A) {
  const Eigen::JacobiSVD<MatrixXd> svd(A, Eigen::ComputeThinU | Eigen::ComputeThinV);
  return {svd.singularValues(), svd.matrixU(), svd.matrixV()};
}

MatrixXd exponential(const MatrixXd& A) { return A.exp(); }

MatrixXd inverse(const MatrixXd& A) { return A.inverse(); }

std::optional<MatrixXd> solution(const MatrixXd& A, const MatrixXd& B) {
  const Eigen::FullPivLU<MatrixXd> lu(A);
  if (!lu.isInvertible()) return {};
  return MatrixXd(lu.solve(B));
}

Eigen::VectorXcd eigenvalues(const MatrixXcd& A) {
  return Eigen::ComplexEigenSolver<MatrixXcd>(A, false).eigenvalues();
}

ComplexEigen complex_eigen(const MatrixXcd& A) {
  const Eigen::ComplexEigenSolver<MatrixXcd> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

double smallest_singular_value(const MatrixXcd& A) {
  // The largest singular value of the inverse costs a fifth of the time of a decomposition of A.
  const MatrixXcd inverse = A.inverse();
  const MatrixXcd square = inverse.adjoint() * inverse;
  if (!square.allFinite()) return 0;
  const Eigen::SelfAdjointEigenSolver<MatrixXcd> solver(square, Eigen::EigenvaluesOnly);
  return 1 / std::sqrt(solver.eigenvalues()[A.rows() - 1]);
}

MatrixXcd complex_inverse(const MatrixXcd& A) { return A.inverse(); }

Schur real_schur(const MatrixXd& A) {
  const Eigen::RealSchur<MatrixXd> schur(A);
  return {schur.matrixT(), schur.matrixU()};
}

ComplexSchur complex_schur(const MatrixXd& A) {
  const Eigen::ComplexSchur<MatrixXd> schur(A);
  return {schur.matrixT(), schur.matrixU()};
}

}  // namespace tachless::numerics
