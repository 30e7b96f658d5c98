#pragma once

#include "certificate/constants.h"
#include "certificate/error_system.h"

/// The conditions that are made of norms: those of Loria and Ortega (1995) as printed, and the
/// completed one. One weight eps = eps_1 = eps_2; continuous time. They are sufficient and very
/// conservative: lead with matrix_condition.h.
namespace tachless::certificate {

struct Interval {
  double low = 0, high = 0;
};

/// How to read what is printed.
struct Reading {
  /// (24) with lambda(Kd B^-1 A) lambda(B) for lambda(Kd A B) / Lambda(B), and (27) with
  /// lambda(Kd B^-1 A) / Lambda(Kd): as printed, neither implies what the proof takes from it when
  /// gains are unequal.
  bool corrected = false;
  /// (27) with gamma_2 free in place of the printed 1/2.
  bool gamma_2_free = false;
};

/// The paper's conditions: some eps with (25) < eps < (19), (20), (23), (24), (27), and (7), for
/// some beta_1 + beta_2 + beta_3 = 1 and gamma_1 + gamma_2 = 1, all > 0. The bounds are given for
/// gamma_1 = beta_1 = beta_3 = 1 (upper ones to be multiplied by the share, the lower one divided).
struct PrintedConditions {
  double eq7 = 0;  ///< b_i > eq7 / beta_2; of flexible joints, eq. 12
  double eq19 = 0, eq20 = 0;
  double eq23 = 0;  ///< times gamma_1
  double eq24 = 0;  ///< times gamma_1 beta_1
  double eq25 = 0;  ///< divided by beta_3
  double eq27 = 0;  ///< for gamma_2 = 1/2
  bool feasible = false;
  Interval epsilon;  ///< for which some beta and gamma exist
  // The best certified ball over eps, beta and gamma.
  double c1 = 0;    ///< eq. 8
  double eq26 = 0;  ///< R = (beta_2 lambda(B) lambda(M) - Lambda(M)) / (2 k_c) [rad; rad/s]
  double best_epsilon = 0;
};

PrintedConditions printed_conditions(const ErrorSystem& system, const RobotConstants& constants,
                                     double B_d, const Reading& reading = {});

/// Norms of a state.
struct StateNorms {
  double e = 0, nu = 0, edot = 0;
  double e_minus_nu = 0;  ///< of the links
};

/// What (22) prints as an upper bound of Vdot, which it is not: the term
/// eps (e - nu)' (Cd' - Cd) edot is missing. With `completed`, its bound
/// 2 k_c B_d eps |e - nu| |edot| is added.
double printed_decrease_bound(const ErrorSystem& system, const RobotConstants& constants,
                              double B_d, double epsilon, const StateNorms& norms, bool completed);

/// The completed scalar condition: Vdot <= -z' Q z, z = (|e|, |nu|, |edot|), where
/// |e - nu| <= rho.
class ScalarCondition {
 public:
  ScalarCondition(const ErrorSystem& system, const RobotConstants& constants,
                  const Postures& postures, double B_d);

  [[nodiscard]] Eigen::Matrix3d Q(double epsilon, double rho) const;
  /// The largest rho with Q > 0; not positive when there is none.
  [[nodiscard]] double rho(double epsilon) const;

  struct Result {
    bool feasible = false;
    Interval epsilon;  ///< with Q > 0 for some rho > 0
    double best_epsilon = 0;
    double rho = 0;  ///< the largest of them
  };
  [[nodiscard]] Result solve() const;

 private:
  double B_d_, k_s_, k_y_;
  double kp_min_, kp_kd_, damping_min_, kd_max_;  // lmin Kp, |Kp - Kd|, lmin Kd B^-1 A, lmax Kd
  double a_inertia_ = 0;                          // sup |A M|
  double b_inertia_ = 0;                          // inf lmin sym((B - I) M)
};

}  // namespace tachless::certificate
