#pragma once

#include <stdexcept>
#include <tuple>

#include "base/elementary.h"
#include "base/quantities.h"
#include "controller/spec.h"

namespace tachless::controller::law {

/// Coefficients of nu_k = phi nu_{k-1} + beta (e_k - e_{k-1}) for one joint.
struct FilterCoefficients {
  double phi = 0;   ///< [1]
  double beta = 0;  ///< [1/s]
};

/// Returns the coefficients of b p / (p + a) sampled every `period_s`.
/// @param a, b [1/s], > 0.
/// @throw std::invalid_argument if a, b or the period is not positive.
inline FilterCoefficients filter_coefficients(Discretisation kind, double a, double b,
                                              double period_s) {
  if (!(a > 0 && b > 0 && period_s > 0)) {
    throw std::invalid_argument("filter: a, b and the period must be greater than 0");
  }
  const double ah = a * period_s;
  switch (kind) {
    case Discretisation::first_order_hold:
      return {base::exp(-ah), -b * base::expm1(-ah) / ah};
    case Discretisation::tustin:
      return {(2 - ah) / (2 + ah), 2 * b / (2 + ah)};
    case Discretisation::backward_euler:
      return {1 / (1 + ah), b / (1 + ah)};
    case Discretisation::zero_order_hold:
      return {base::exp(-ah), b};
  }
  throw std::logic_error("filter: no such discretisation");
}

/// The dirty derivative nu = diag{ b_i p / (p + a_i) } e from samples of e (paper, eq. 4-5; there
/// vartheta). It satisfies nudot = -A nu + B edot. The laws use nu instead of edot, because
/// velocity is not measured. The filter does not differentiate, and it does not know the reference.
class Filter {
 public:
  /// State of the filter from one sample to the next.
  struct Memory {
    Vector nu;          ///< [rad/s]
    Vector e_previous;  ///< [rad]

    static constexpr std::tuple members{&Memory::nu, &Memory::e_previous};
  };

  /// @param a, b [1/s], one entry per joint, > 0.
  /// @param period_s [s], > 0.
  /// @throw std::invalid_argument if one of them is not positive or the lengths differ.
  Filter(const Vector& a, const Vector& b, Discretisation kind, FilterStart start, double period_s)
      : a_(a), b_(b), start_(start), phi_(a), beta_(a) {
    if (a.size() != b.size()) {
      throw std::invalid_argument("filter: a and b must have one entry per joint");
    }
    for (Eigen::Index i = 0; i < a.size(); ++i) {
      const FilterCoefficients joint = filter_coefficients(kind, a[i], b[i], period_s);
      phi_[i] = joint.phi;
      beta_[i] = joint.beta;
    }
  }

  /// Returns the memory before the first sample e(0) [rad]. With this memory and e(0), `step`
  /// returns the nu(0) that the kind of start asks for.
  [[nodiscard]] Memory start(const Vector& e) const {
    Memory memory{Vector::Zero(e.size()), e};
    if (start_ == FilterStart::zero) {
      // This makes beta (e - e_previous) equal to B e.
      memory.e_previous -= b_.cwiseQuotient(beta_).cwiseProduct(e);
    }
    return memory;
  }

  /// Returns the memory after the next sample e [rad]. Its `nu` is the filter's output for this
  /// sample.
  [[nodiscard]] Memory step(const Memory& memory, const Vector& e) const {
    return {phi_.cwiseProduct(memory.nu) + beta_.cwiseProduct(e - memory.e_previous), e};
  }

  /// Returns nudot = -A nu + B edot, the right-hand side of the continuous filter [rad/s^2].
  [[nodiscard]] Vector derivative(const Vector& nu, const Vector& edot) const {
    return b_.cwiseProduct(edot) - a_.cwiseProduct(nu);
  }

 private:
  Vector a_, b_;
  FilterStart start_;
  Vector phi_, beta_;
};

}  // namespace tachless::controller::law
