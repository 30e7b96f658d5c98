#pragma once

#include <Eigen/Core>

#include "controller/law/parts.h"

/// The closed loop in the paper's error coordinates (eq. 14, 29), rigid and flexible in one form,
///
///   M eddot + [C(q, v) + C(q, v_ref) + D] edot + Kp e + Kd nu = 0,   nudot = -A nu + B edot,
///
/// in continuous time, with an exact model and without saturation, quantisation or delay.
///
/// With flexible joints e = (e1, e2) and nu = (nu1, nu2), M becomes blockdiag(M_l, J), C becomes
/// blockdiag(C, 0), Kp becomes [Kp1 + K, -K; -K, Kp2 + K], and Kd, A and B are block diagonal.
namespace tachless::lyapunov {

/// The constant part of the error equation. `num_errors` is n for rigid joints and 2 n for flexible
/// joints. The links' errors come first.
struct ErrorSystem {
  Eigen::MatrixXd kp;             ///< [N m/rad], symmetric
  Eigen::MatrixXd kd;             ///< [N m s/rad], symmetric, as are Kd B^-1 and Kd B^-1 A
  Eigen::VectorXd a, b;           ///< [1/s]
  Eigen::VectorXd rotor_inertia;  ///< J [kg m2]; empty for rigid joints
  Eigen::VectorXd damping = {};   ///< D of the joints' viscous friction [N m s/rad]; empty: none
  /// Rates of gains that follow the reference, at one instant [N m/(rad s), N m/rad], and the
  /// reference's velocity v_ref [rad/s]. Empty: the gains are constant.
  Eigen::MatrixXd kp_dot = {}, kd_dot = {};
  Eigen::VectorXd v_ref = {};

  [[nodiscard]] Eigen::Index num_errors() const { return a.size(); }
  [[nodiscard]] Eigen::Index num_links() const { return a.size() - rotor_inertia.size(); }
  [[nodiscard]] Eigen::MatrixXd kd_by_b() const { return kd * b.cwiseInverse().asDiagonal(); }

  /// Returns blockdiag(M, J), with M of the links.
  [[nodiscard]] Eigen::MatrixXd inertia(const Eigen::MatrixXd& link_M) const;
};

/// The gains of one filtered spring and damper.
using controller::law::FilterGains;

/// Returns the error system of flexible joints.
ErrorSystem flexible_error_system(const Eigen::VectorXd& stiffness,
                                  const Eigen::VectorXd& rotor_inertia, const FilterGains& link,
                                  const FilterGains& motor);

inline Eigen::MatrixXd symmetric_part(const Eigen::MatrixXd& A) { return (A + A.transpose()) / 2; }

/// The weights of the cross terms in
///
///   V = 1/2 edot' M edot + 1/2 e' Kp e + 1/2 nu' Kd B^-1 nu + (E1 e - E2 nu)' M edot,
///
/// E1 = diag(eps_1), E2 = diag(eps_2).
using Weights = controller::law::LyapunovWeights;

/// Returns diag(Kp, Kd B^-1), the matrix of V's part in (e, nu).
Eigen::MatrixXd stiffness_of(const ErrorSystem& system);

/// Returns N of E1 e - E2 nu = N (e, nu); delta is the links' part.
Eigen::MatrixXd delta_of(const ErrorSystem& system, const Weights& weights);

/// Returns the part of P below that is linear in M. @param weights one of each row of M
Eigen::MatrixXd lyapunov_of_inertia(const Weights& weights, const Eigen::MatrixXd& M);

/// Returns P of V = 1/2 x' P x, x = (e, nu, edot).
Eigen::MatrixXd lyapunov_matrix(const ErrorSystem& system, const Weights& weights,
                                const Eigen::MatrixXd& link_M);

/// Returns the constant part of Mm, with Vdot = -x' Mm x exactly and delta = E1 e1 - E2 nu1 of the
/// links:
///
///   sym(E1 Kp)   1/2 (E1 Kd - Kp E2)       1/2 E1 (D - W)                 W = Cd' - Cd
///                Kd B^-1 A - sym(E2 Kd)    -1/2 E2 A M - 1/2 E2 (D - W)   Cd = C(q, v_ref)
///                             D + sym(Cd) + sym(E2 B M) - sym(E1 M) - sym C(q, delta)
///
/// less 1/2 Kp_dot in the first and 1/2 Kd_dot B^-1 in the second block. The functions below return
/// the part that is linear in M, and the part that is linear in Cd. The term in delta is in none of
/// the parts: it is -sym C(q, delta) in the links' corner of the last block. The result uses two
/// properties of the weights: they are constant, and E2 commutes with A and B. It also uses Mdot =
/// C + C' and C(q, x) y = C(q, y) x. By these properties, delta' (Mdot - C(q, v) - Cd) edot is
/// delta' (Cd' - Cd) edot + edot' C(q, delta) edot.
Eigen::MatrixXd decrease_constant(const ErrorSystem& system, const Weights& weights);
Eigen::MatrixXd decrease_of_inertia(const ErrorSystem& system, const Weights& weights,
                                    const Eigen::MatrixXd& link_M);
Eigen::MatrixXd decrease_of_coriolis(const ErrorSystem& system, const Weights& weights,
                                     const Eigen::MatrixXd& link_Cd);

}  // namespace tachless::lyapunov
