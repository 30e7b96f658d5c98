#pragma once

#include <Eigen/Core>
#include <optional>

/// Eigen's decompositions of matrices of any size. They are compiled once here, because their
/// templates add seconds to each source file that instantiates them. All matrices must be finite.
namespace tachless::numerics {

/// Returns the eigenvalues of a square matrix in no particular order.
Eigen::VectorXcd eigenvalues(const Eigen::MatrixXd& A);
Eigen::VectorXcd eigenvalues(const Eigen::MatrixXcd& A);

/// Returns the eigenvalues of a symmetric matrix in ascending order. This function and the two
/// below read the lower triangle alone.
Eigen::VectorXd symmetric_eigenvalues(const Eigen::MatrixXd& A);
double smallest_eigenvalue(const Eigen::MatrixXd& symmetric);
double largest_eigenvalue(const Eigen::MatrixXd& symmetric);

/// Returns the matrix norm induced by the Euclidean norm.
double spectral_norm(const Eigen::MatrixXd& A);

/// Eigendecomposition A = vectors diag(values) vectors' of a symmetric matrix, values ascending.
struct SymmetricEigen {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& A);

/// Eigendecomposition A vectors = vectors diag(values) of a general matrix.
struct ComplexEigen {
  Eigen::VectorXcd values;
  Eigen::MatrixXcd vectors;
};
ComplexEigen complex_eigen(const Eigen::MatrixXcd& A);

double smallest_singular_value(const Eigen::MatrixXcd& A);
/// Returns the singular values in descending order.
Eigen::VectorXd singular_values(const Eigen::MatrixXd& A);

/// Thin singular value decomposition A = U diag(values) V', values descending.
struct Singular {
  Eigen::VectorXd values;
  Eigen::MatrixXd U, V;
};
Singular singular(const Eigen::MatrixXd& A);

/// Real Schur form A = U T U' with U orthogonal. T is upper triangular but for blocks of two rows
/// on its diagonal, which have a pair of complex eigenvalues each.
struct Schur {
  Eigen::MatrixXd T, U;
};
Schur real_schur(const Eigen::MatrixXd& A);

/// Schur form A = U T U* with U unitary and T upper triangular.
struct ComplexSchur {
  Eigen::MatrixXcd T, U;
};
ComplexSchur complex_schur(const Eigen::MatrixXd& A);

/// Returns exp(A).
Eigen::MatrixXd exponential(const Eigen::MatrixXd& A);

/// Return the inverse of an invertible matrix.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& A);
Eigen::MatrixXcd complex_inverse(const Eigen::MatrixXcd& A);

/// Returns the X that solves A X = B, or nothing when A is numerically singular.
std::optional<Eigen::MatrixXd> solution(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

}  // namespace tachless::numerics
