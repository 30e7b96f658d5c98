#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

/// The closed loop of a law in the error coordinates y and the links' error rate edot. A Lyapunov
/// function with full weights certifies a region of it:
///
///   M eddot + [C(q, v) + Cd + D] edot = Gam y,   ydot = Fy y + Fe edot,   Cd = C(q, v_ref),
///   V = 1/2 edot' M edot + 1/2 y' P y + (N y)' M edot,   delta = N y.
///
/// The paper's V (eq. 15) is P = diag(Kp, Kd B^-1), N = [E1, -E2]. Time is continuous, and the
/// model is exact.
namespace tachless::lyapunov {

/// The loop at one posture and one instant of the reference.
struct ErrorForm {
  Eigen::MatrixXd Fy, Fe, Gam;
  Eigen::MatrixXd M;               ///< of the links [kg m2]
  Eigen::MatrixXd Cd;              ///< [N m s/rad]
  Eigen::VectorXd damping;         ///< D [N m s/rad]
  std::vector<Eigen::MatrixXd> C;  ///< C(q, x) = sum x_j C[j] [kg m2]
};

/// The weights of V.
struct FormWeights {
  Eigen::MatrixXd P, N;
};

/// Returns the matrix of 2 V in x = (y, edot).
Eigen::MatrixXd lyapunov_matrix(const ErrorForm& form, const FormWeights& weights);

/// Returns Mm with Vdot = -x' Mm x + edot' C(q, delta) edot exactly:
///
///   -Mm = sym [ P Fy + N' Gam,  P Fe + Fy' N' M + N' (W - D) + Gam';
///               0,              -Cd - D + (N Fe)' M ],   W = Cd' - Cd.
Eigen::MatrixXd decrease_matrix(const ErrorForm& form, const FormWeights& weights);

/// The region that weights certify over a set of forms.
struct FormRegion {
  double level = 0;         ///< V <= level is invariant, and V falls in it [J]
  double rho = 0;           ///< V falls where |L^-1 delta| <= rho, L L' = N P^-1 N' [J^1/2]
  double rate = 0;          ///< of V in the limit of small errors [1/s]; errors decay at half of it
  std::size_t binding = 0;  ///< the form that ends the region
};

/// The result of given weights at one form.
struct FormResult {
  double rho = 0;   ///< as in `FormRegion`; 0: nothing is certified
  double rate = 0;  ///< [1/s]
  double w = 0;     ///< largest |L^-1 delta|^2 of V = 1/2 J
};

/// Returns L of the norm |L^-1 delta|. Precondition: P is positive definite.
Eigen::MatrixXd delta_norm(const FormWeights& weights);

/// Returns the region that holds at all of the forms.
FormRegion region_of(const std::vector<FormResult>& all);

/// Returns the region; its rho is 0 where V or Mm is not positive definite at the binding form.
FormRegion region_of(const std::vector<ErrorForm>& forms, const FormWeights& weights);

/// Entries of P and N that a search of weights may choose; all others are 0.
struct FormEntries {
  std::vector<std::pair<Eigen::Index, Eigen::Index>> P;  ///< row <= column
  std::vector<std::pair<Eigen::Index, Eigen::Index>> N;
};

/// Searches for the weights with the largest level over the forms, such that V decays at `rate` or
/// faster in each form. Returns nothing if no weights are found.
/// @param size typical size of P's diagonal
/// @param from weights with which the search begins, if there are any
std::optional<FormWeights> best_form_weights(const std::vector<ErrorForm>& forms,
                                             const FormEntries& entries,
                                             const Eigen::VectorXd& size, double rate,
                                             const std::optional<FormWeights>& from = {});

}  // namespace tachless::lyapunov
