// Apart from the real ones, so that both compile at once.
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>

#include "robot/decompositions.h"

namespace tachless::robot {

using Eigen::MatrixXcd;

Eigen::VectorXcd eigenvalues(const MatrixXcd& A) {
  return Eigen::ComplexEigenSolver<MatrixXcd>(A, false).eigenvalues();
}

ComplexEigen complex_eigen(const MatrixXcd& A) {
  const Eigen::ComplexEigenSolver<MatrixXcd> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

double smallest_singular_value(const MatrixXcd& A) {
  const Eigen::JacobiSVD<MatrixXcd> svd(A);
  return svd.singularValues()[svd.singularValues().size() - 1];
}

MatrixXcd complex_inverse(const MatrixXcd& A) { return A.inverse(); }

Schur complex_schur(const Eigen::MatrixXd& A) {
  const Eigen::ComplexSchur<Eigen::MatrixXd> schur(A);
  return {schur.matrixT(), schur.matrixU()};
}

}  // namespace tachless::robot
