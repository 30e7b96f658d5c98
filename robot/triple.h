#pragma once

#include <Eigen/Core>
#include <cstring>
#include <type_traits>

#include "robot/jet.h"
#include "robot/model.h"

/// Vectors and matrices of three that the recursions of this room are written in: each sum in one
/// stated order, whatever compiler and processor, and always inline (Eigen's products of 3 x 3 are
/// calls at -O2).
///
/// `Two` is two doubles that are computed with in one instruction, each rounded as it would be
/// alone: one matrix turns two vectors.
namespace tachless::robot {

using Two = double __attribute__((vector_size(16)));

#define TACHLESS_INLINE [[gnu::always_inline]] inline

/// Two jets.
struct JetTwo {
  Two value, first, second;
};
TACHLESS_INLINE JetTwo operator+(const JetTwo& a, const JetTwo& b) {
  return {a.value + b.value, a.first + b.first, a.second + b.second};
}
TACHLESS_INLINE JetTwo operator-(const JetTwo& a, const JetTwo& b) {
  return {a.value - b.value, a.first - b.first, a.second - b.second};
}
template <class Jet>
TACHLESS_INLINE JetTwo operator*(const JetTwo& a, const Jet& b) {
  return {a.value * b.value, a.first * b.value + a.value * b.first,
          a.second * b.value + 2 * (a.first * b.first) + a.value * b.second};
}
TACHLESS_INLINE JetTwo operator*(const Jet2& a, const JetTwo& b) {
  return {a.value * b.value, a.first * b.value + a.value * b.first,
          a.second * b.value + 2 * (a.first * b.first) + a.value * b.second};
}
TACHLESS_INLINE JetTwo operator*(const JetTwo& a, double s) {
  return {a.value * s, a.first * s, a.second * s};
}
TACHLESS_INLINE JetTwo operator*(double s, const JetTwo& a) { return a * s; }

template <class S>
struct Triple {
  S x, y, z;
};

/// Column by column, as Eigen's.
template <class S>
struct Turn {
  S m[9];
};

template <class S>
TACHLESS_INLINE Triple<S> operator+(const Triple<S>& a, const Triple<S>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class S>
TACHLESS_INLINE Triple<S> operator-(const Triple<S>& a, const Triple<S>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class S, class T>
TACHLESS_INLINE auto operator*(const Triple<S>& a, const T& s) {
  return Triple<decltype(a.x * s)>{a.x * s, a.y * s, a.z * s};
}
template <class S>
TACHLESS_INLINE Triple<S>& operator+=(Triple<S>& a, const Triple<S>& b) {
  return a = a + b;
}

/// Of one scalar kind and another: a double and a jet, two doubles and one.
template <class A, class B>
TACHLESS_INLINE auto cross(const Triple<A>& a, const Triple<B>& b) {
  return Triple<decltype(a.x * b.x)>{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z,
                                     a.x * b.y - a.y * b.x};
}

/// a + b + c from the left; jets, and the last row of a product with a matrix, from the right.
template <bool last_row, class S>
TACHLESS_INLINE S sum(const S& a, const S& b, const S& c) {
  if constexpr (last_row || std::is_same_v<S, Jet2> || std::is_same_v<S, JetTwo>) {
    const S rest = b + c;
    return a + rest;
  } else {
    const S rest = a + b;
    return rest + c;
  }
}

template <class A, class B>
TACHLESS_INLINE auto dot(const Triple<A>& a, const Triple<B>& b) {
  return sum<false>(a.x * b.x, a.y * b.y, a.z * b.z);
}

/// R v.
template <class A, class B>
TACHLESS_INLINE auto operator*(const Turn<A>& R, const Triple<B>& v) {
  const A* m = R.m;
  return Triple<decltype(m[0] * v.x)>{sum<false>(m[0] * v.x, m[3] * v.y, m[6] * v.z),
                                      sum<false>(m[1] * v.x, m[4] * v.y, m[7] * v.z),
                                      sum<true>(m[2] * v.x, m[5] * v.y, m[8] * v.z)};
}

/// R' v.
template <class A, class B>
TACHLESS_INLINE auto turned_back(const Turn<A>& R, const Triple<B>& v) {
  const A* m = R.m;
  return Triple<decltype(m[0] * v.x)>{sum<false>(m[0] * v.x, m[1] * v.y, m[2] * v.z),
                                      sum<false>(m[3] * v.x, m[4] * v.y, m[5] * v.z),
                                      sum<false>(m[6] * v.x, m[7] * v.y, m[8] * v.z)};
}

TACHLESS_INLINE Triple<double> triple(const Eigen::Vector3d& a) { return {a[0], a[1], a[2]}; }
template <class S>
TACHLESS_INLINE Triple<S> zero_triple() {
  return {S(0), S(0), S(0)};
}
TACHLESS_INLINE Turn<double> turn(const Eigen::Matrix3d& a) {
  return {{a(0), a(1), a(2), a(3), a(4), a(5), a(6), a(7), a(8)}};
}

template <class S>
TACHLESS_INLINE Triple<S> column(const Turn<S>& A, int j) {
  return {A.m[3 * j], A.m[3 * j + 1], A.m[3 * j + 2]};
}
template <class S>
TACHLESS_INLINE Turn<S> columns(const Triple<S>& a, const Triple<S>& b, const Triple<S>& c) {
  return {{a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z}};
}

/// Two values of one kind, computed with at once; two neighbours in memory.
TACHLESS_INLINE Two pair(double a, double b) { return Two{a, b}; }
TACHLESS_INLINE JetTwo pair(const Jet2& a, const Jet2& b) {
  return {Two{a.value, b.value}, Two{a.first, b.first}, Two{a.second, b.second}};
}
TACHLESS_INLINE Two pair_at(const double* from) {
  Two x;
  std::memcpy(&x, from, sizeof x);
  return x;
}
TACHLESS_INLINE JetTwo pair_at(const Jet2* from) { return pair(from[0], from[1]); }
template <int i>
TACHLESS_INLINE double part(const Two& a) {
  return a[i];
}
template <int i>
TACHLESS_INLINE Jet2 part(const JetTwo& a) {
  return {a.value[i], a.first[i], a.second[i]};
}
/// One value, or two neighbours, into memory.
template <class S>
TACHLESS_INLINE void put(const S& x, S* to) {
  *to = x;
}
TACHLESS_INLINE void put(const Two& x, double* to) { std::memcpy(to, &x, sizeof x); }
TACHLESS_INLINE void put(const JetTwo& x, Jet2* to) { to[0] = part<0>(x), to[1] = part<1>(x); }
template <class S>
TACHLESS_INLINE auto pair(const Triple<S>& a, const Triple<S>& b) {
  return Triple<decltype(pair(a.x, b.x))>{pair(a.x, b.x), pair(a.y, b.y), pair(a.z, b.z)};
}
template <int i, class P>
TACHLESS_INLINE auto part(const Triple<P>& a) {
  return Triple<decltype(part<i>(a.x))>{part<i>(a.x), part<i>(a.y), part<i>(a.z)};
}

/// to -= u s, each of n.
TACHLESS_INLINE void subtract_scaled(double* to, const double* u, double s, Eigen::Index n) {
  Eigen::Index i = 0;
  for (; i + 1 < n; i += 2) put(pair_at(to + i) - pair_at(u + i) * s, to + i);
  if (i < n) to[i] -= u[i] * s;
}
TACHLESS_INLINE void subtract_scaled(Jet2* to, const Jet2* u, const Jet2& s, Eigen::Index n) {
  for (Eigen::Index i = 0; i < n; ++i) to[i] -= u[i] * s;
}

}  // namespace tachless::robot
