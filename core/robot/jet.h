#pragma once

#include <Eigen/Core>
#include <type_traits>

#include "base/elementary.h"
#include "base/quantities.h"

namespace tachless::robot {

/// A value with its first and second time derivative (the derivatives themselves, not Taylor
/// coefficients). A templated formula maps the jets of its inputs to the jet of its output, exact
/// to rounding.
struct Jet2 {
  double value;
  double first;   ///< [1/s]
  double second;  ///< [1/s^2]

  /// Uninitialised, like double; `Jet2{}` is zero.
  Jet2() = default;
  // NOLINTNEXTLINE(google-explicit-constructor): a constant is a jet, as in any number type.
  constexpr Jet2(double constant) : value(constant), first(0), second(0) {}
  constexpr Jet2(double v, double d, double dd) : value(v), first(d), second(dd) {}

  constexpr Jet2& operator+=(const Jet2& b) {
    return *this = {value + b.value, first + b.first, second + b.second};
  }
  constexpr Jet2& operator-=(const Jet2& b) {
    return *this = {value - b.value, first - b.first, second - b.second};
  }
  constexpr Jet2& operator*=(const Jet2& b) {
    return *this = {value * b.value, first * b.value + value * b.first,
                    second * b.value + 2 * (first * b.first) + value * b.second};
  }
  /// From a = c b: c' = (a' - c b') / b, c'' = (a'' - 2 c' b' - c b'') / b.
  constexpr Jet2& operator/=(const Jet2& b) {
    const double c = value / b.value;
    const double c1 = (first - c * b.first) / b.value;
    const double c2 = (second - 2 * (c1 * b.first) - c * b.second) / b.value;
    return *this = {c, c1, c2};
  }
  constexpr Jet2& operator*=(double s) { return *this = {value * s, first * s, second * s}; }

  constexpr bool operator==(const Jet2& b) const = default;
};
static_assert(std::is_trivially_copyable_v<Jet2>);
static_assert(std::is_trivially_default_constructible_v<Jet2>);

constexpr Jet2 operator-(const Jet2& a) { return {-a.value, -a.first, -a.second}; }
constexpr Jet2 operator+(Jet2 a, const Jet2& b) { return a += b; }
constexpr Jet2 operator-(Jet2 a, const Jet2& b) { return a -= b; }
constexpr Jet2 operator*(Jet2 a, const Jet2& b) { return a *= b; }
constexpr Jet2 operator/(Jet2 a, const Jet2& b) { return a /= b; }
constexpr Jet2 operator+(const Jet2& a, double s) { return {a.value + s, a.first, a.second}; }
constexpr Jet2 operator+(double s, const Jet2& a) { return a + s; }
constexpr Jet2 operator*(Jet2 a, double s) { return a *= s; }
constexpr Jet2 operator*(double s, Jet2 a) { return a *= s; }

/// Returns the jet of f(x) from f, f' and f'' at the value of x (chain rule).
constexpr Jet2 chain(const Jet2& x, double f, double df, double ddf) {
  return {f, df * x.first, df * x.second + ddf * (x.first * x.first)};
}

inline void sin_cos(const Jet2& x, Jet2& s, Jet2& c) {
  double sv = 0, cv = 0;
  base::sin_cos(x.value, sv, cv);
  s = chain(x, sv, cv, -sv);
  c = chain(x, cv, -sv, -cv);
}
using base::sin_cos;

}  // namespace tachless::robot

namespace Eigen {

template <>
struct NumTraits<tachless::robot::Jet2> : GenericNumTraits<double> {
  using Real = tachless::robot::Jet2;
  using NonInteger = tachless::robot::Jet2;
  using Nested = tachless::robot::Jet2;
  enum { ReadCost = 3, AddCost = 3, MulCost = 9 };
};

template <class BinaryOp>
struct ScalarBinaryOpTraits<tachless::robot::Jet2, double, BinaryOp> {
  using ReturnType = tachless::robot::Jet2;
};
template <class BinaryOp>
struct ScalarBinaryOpTraits<double, tachless::robot::Jet2, BinaryOp> {
  using ReturnType = tachless::robot::Jet2;
};

}  // namespace Eigen

namespace tachless::robot {

using JetVector = VectorOf<Jet2>;

/// Returns the jet of a vector from its value and its first two time derivatives, all of one size.
inline JetVector jet(const Vector& value, const Vector& first, const Vector& second) {
  eigen_assert(value.size() == first.size() && value.size() == second.size());
  JetVector x(value.size());
  for (Eigen::Index i = 0; i < x.size(); ++i) x[i] = {value[i], first[i], second[i]};
  return x;
}
inline Vector value(const JetVector& x) {
  return x.unaryExpr([](const Jet2& jet) { return jet.value; });
}
inline Vector first_derivative(const JetVector& x) {
  return x.unaryExpr([](const Jet2& jet) { return jet.first; });
}
inline Vector second_derivative(const JetVector& x) {
  return x.unaryExpr([](const Jet2& jet) { return jet.second; });
}

}  // namespace tachless::robot
