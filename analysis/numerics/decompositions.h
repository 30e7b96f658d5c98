#pragma once

#include <Eigen/Core>
#include <optional>

/// Eigen's decompositions of matrices of any size, compiled once: their templates take seconds in
/// each source that instantiates them. The matrices are finite.
namespace tachless::numerics {

/// Of a square matrix, in no particular order.
Eigen::VectorXcd eigenvalues(const Eigen::MatrixXd& A);
Eigen::VectorXcd eigenvalues(const Eigen::MatrixXcd& A);

/// Of a symmetric matrix, of which the lower triangle is read; the smallest first.
Eigen::VectorXd symmetric_eigenvalues(const Eigen::MatrixXd& A);
double smallest_eigenvalue(const Eigen::MatrixXd& symmetric);
double largest_eigenvalue(const Eigen::MatrixXd& symmetric);

/// The norm that goes with the Euclidean one.
double spectral_norm(const Eigen::MatrixXd& A);

/// A = vectors diag(values) vectors', the smallest value first.
struct SymmetricEigen {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& A);

/// A vectors = vectors diag(values).
struct ComplexEigen {
  Eigen::VectorXcd values;
  Eigen::MatrixXcd vectors;
};
ComplexEigen complex_eigen(const Eigen::MatrixXcd& A);

double smallest_singular_value(const Eigen::MatrixXcd& A);
Eigen::VectorXd singular_values(const Eigen::MatrixXd& A);

/// A = U diag(values) V', with as many columns as A has rows or columns, the largest value first.
struct Singular {
  Eigen::VectorXd values;
  Eigen::MatrixXd U, V;
};
Singular singular(const Eigen::MatrixXd& A);

/// A = U T U*, U unitary and T upper triangular.
struct Schur {
  Eigen::MatrixXcd T, U;
};
Schur complex_schur(const Eigen::MatrixXd& A);

/// exp(A).
Eigen::MatrixXd exponential(const Eigen::MatrixXd& A);

/// Of an invertible matrix.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& A);
Eigen::MatrixXcd complex_inverse(const Eigen::MatrixXcd& A);

/// X of A X = B; nothing when A is singular to rounding.
std::optional<Eigen::MatrixXd> solution(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

}  // namespace tachless::numerics
