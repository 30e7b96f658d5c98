#pragma once

#include "controller/law/filter.h"
#include "controller/law/parts.h"

namespace tachless::controller::law {

/// The integral y of ydot = edot + eps_1 e - eps_2 nu from positions alone, and its torque -Ki y.
/// ydot is the passive output for eq. 15 of Loria and Ortega (1995) with these weights. The
/// filter's own equation gives the integral of nu: A^-1 (B (e - e(0)) - (nu - nu(0))). e is taken
/// to be linear between samples.
struct PassiveIntegral {
  Vector ki;  ///< [N m/rad]
  double eps_1 = 0, eps_2 = 0;
  Vector a, b;   ///< pole and gain of the filter [1/s]
  Vector d_max;  ///< largest |Ki y| [N m]; infinite: no bound
  double period_s = 0;

  /// Returns y after the step of the filter from `from` to `to`, projected onto |Ki y| <= d_max.
  [[nodiscard]] Vector next(const Vector& y, const Filter::Memory& from,
                            const Filter::Memory& to) const {
    return within(y + increment(from, to));
  }
  /// Returns y before a step for which y is 0 after that step.
  [[nodiscard]] Vector before_zero(const Filter::Memory& from, const Filter::Memory& to) const {
    return -increment(from, to);
  }
  /// Returns y projected onto |Ki y| <= d_max.
  [[nodiscard]] Vector within(const Vector& y) const {
    const Vector most = d_max.cwiseQuotient(ki);
    return y.cwiseMax(-most).cwiseMin(most);
  }
  /// Returns -Ki y [N m].
  [[nodiscard]] Vector torque(const Vector& y) const { return -ki.cwiseProduct(y); }

  /// Returns the weights of V for which ydot is the passive output.
  [[nodiscard]] LyapunovWeights weights() const { return {eps_1, eps_2}; }
  /// Returns the part of V that belongs to the integral, for an unknown torque of zero [J].
  [[nodiscard]] double lyapunov(const Vector& torque) const {
    return 0.5 * weighted(ki.cwiseInverse(), torque);
  }

 private:
  [[nodiscard]] Vector increment(const Filter::Memory& from, const Filter::Memory& to) const {
    const Vector de = to.e_previous - from.e_previous;
    const Vector nu_dt = (b.cwiseProduct(de) - to.nu + from.nu).cwiseQuotient(a);
    return de + 0.5 * period_s * eps_1 * (from.e_previous + to.e_previous) - eps_2 * nu_dt;
  }
};

}  // namespace tachless::controller::law
