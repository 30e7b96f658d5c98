#include "robot/dynamics.h"

#include <algorithm>

#include "robot/joint_frames.h"

namespace tachless::robot {
namespace {

/// a.b 1 - a b': the parallel-axis matrix of the pair (a, b).
template <class S>
TACHLESS_INLINE Turn<S> parallel_axis(const Triple<S>& a, const Triple<S>& b) {
  const S d = dot(a, b);
  return {{d - a.x * b.x, -(a.y * b.x), -(a.z * b.x),  //
           -(a.x * b.y), d - a.y * b.y, -(a.z * b.y),  //
           -(a.x * b.z), -(a.y * b.z), d - a.z * b.z}};
}

template <class S>
TACHLESS_INLINE void start(const Body& body, Composite<S>& b) {
  const Triple<double> c = triple(body.p_Bcm), h = c * body.mass;
  const Turn<double> shift = parallel_axis(c, c);
  b.mass = body.mass;
  b.h = {S(h.x), S(h.y), S(h.z)};
  for (int i = 0; i < 9; ++i) b.I.m[i] = S(body.I_Bcm.data()[i] + body.mass * shift.m[i]);
}

/// Adds the composite of `b`, whose frame in its parent's is X, to the parent's.
template <class S>
TACHLESS_INLINE void add(const Composite<S>& b, const JointFrame<S>& X, Composite<S>& parent) {
  // R I, two columns at a time, and R h with the third.
  const auto two = X.R * pair(column(b.I, 0), column(b.I, 1));
  const auto third = X.R * pair(column(b.I, 2), b.h);
  const Turn<S> RI = columns(part<0>(two), part<1>(two), part<0>(third));
  const Triple<S> h = part<1>(third);
  const S* R = X.R.m;
  const auto left = RI * pair(Triple<S>{R[0], R[3], R[6]}, Triple<S>{R[1], R[4], R[7]});
  const Triple<S> columns[3] = {part<0>(left), part<1>(left), RI * Triple<S>{R[2], R[5], R[8]}};
  const Turn<S> mixed = parallel_axis(X.p, h), shift = parallel_axis(X.p, X.p);
  for (int j = 0; j < 3; ++j) {
    const S I[3] = {columns[j].x, columns[j].y, columns[j].z};
    for (int i = 0; i < 3; ++i) {
      const int k = i + 3 * j;
      parent.I.m[k] += I[i] + mixed.m[k] + mixed.m[j + 3 * i] + b.mass * shift.m[k];
    }
  }
  parent.h += h + X.p * b.mass;
  parent.mass += b.mass;
}

/// Momentum of each body's composite under unit rate of its joint, about and in the frame of the
/// body that it has been carried to. Those of a subtree are side by side.
template <class S>
struct Momenta {
  S linear[3][max_bodies], angular[3][max_bodies];
};

/// One or two (L) neighbours.
template <class L, class S>
TACHLESS_INLINE L at(const S* from) {
  if constexpr (std::is_same_v<S, L>) {
    return *from;
  } else {
    return pair_at(from);
  }
}
template <class L, class S>
TACHLESS_INLINE Triple<L> load(const S (&from)[3][max_bodies], int place) {
  return {at<L>(from[0] + place), at<L>(from[1] + place), at<L>(from[2] + place)};
}
template <class L, class S>
TACHLESS_INLINE void store(const Triple<L>& x, S (&to)[3][max_bodies], int place) {
  put(x.x, to[0] + place), put(x.y, to[1] + place), put(x.z, to[2] + place);
}

/// Sets `to` from `begin` to `end` to what `value` makes of one or two (L) neighbours there.
template <class S, class Value>
TACHLESS_INLINE void set_each(int begin, int end, S* to, const Value& value) {
  int place = begin;
  for (; place + 1 < end; place += 2) {
    put(value(decltype(pair(S(), S()))(), place), to + place);
  }
  if (place < end) put(value(S(), place), to + place);
}

/// Carries two momenta from a body's frame to its parent's, or one.
template <class S>
TACHLESS_INLINE void carry_two(Momenta<S>& momenta, int at, const JointFrame<S>& X) {
  using Both = decltype(pair(S(), S()));
  const Triple<Both> linear = X.R * load<Both>(momenta.linear, at);
  store(linear, momenta.linear, at);
  store(X.R * load<Both>(momenta.angular, at) + cross(X.p, linear), momenta.angular, at);
}
template <class S>
TACHLESS_INLINE void carry_one(Momenta<S>& momenta, int at, const JointFrame<S>& X) {
  const auto both = X.R * pair(load<S>(momenta.linear, at), load<S>(momenta.angular, at));
  store(part<0>(both), momenta.linear, at);
  store(part<1>(both) + cross(X.p, part<0>(both)), momenta.angular, at);
}

/// What of momenta `begin` to `end` acts along a joint's axis.
template <class S>
TACHLESS_INLINE void set_along(const S (&momenta)[3][max_bodies], int begin, int end,
                               const Triple<double>& axis, S* to) {
  set_each(begin, end, to, [&]<class L>(L /*one or two*/, int place) {
    const Triple<L> m = load<L>(momenta, place);
    return axis.x * m.x + axis.y * m.y + axis.z * m.z;
  });
}

/// From this many bodies on, momenta are taken to the base at once instead of from body to body: n
/// transforms in place of up to n^2 / 2. Below, carrying costs no more and rounds less.
constexpr int many_bodies = 13;

/// A joint's motion at unit rate, of the point of its body that is at the base's origin.
template <class S>
struct Motion {
  Triple<S> angular, linear;
};

/// Power of momenta `begin` to `end` under a motion, all at the base.
template <class S>
TACHLESS_INLINE void set_power(const Momenta<S>& momenta, int begin, int end, const Motion<S>& m,
                               S* to) {
  set_each(begin, end, to, [&]<class L>(L /*one or two*/, int place) {
    const Triple<L> n = load<L>(momenta.angular, place), p = load<L>(momenta.linear, place);
    return (m.angular.x * n.x + m.angular.y * n.y + m.angular.z * n.z) +
           (m.linear.x * p.x + m.linear.y * p.y + m.linear.z * p.z);
  });
}

/// Each body's frame in the base.
template <class S>
TACHLESS_INLINE void set_base_frames(const Model& model, const JointFrame<S>* frames,
                                     JointFrame<S>* base) {
  const int num_bodies = static_cast<int>(model.bodies.size());
  for (int i = 0; i < num_bodies; ++i) {
    const int parent = model.bodies[i].parent;
    const JointFrame<S>& X = frames[i];
    if (parent < 0) {
      base[i] = X;
      continue;
    }
    const JointFrame<S>& P = base[parent];
    const auto two = P.R * pair(column(X.R, 0), column(X.R, 1));
    const auto third = P.R * pair(column(X.R, 2), X.p);
    base[i].R = columns(part<0>(two), part<1>(two), part<0>(third));
    base[i].p = P.p + part<1>(third);
  }
}

/// The momentum at place `at` and a joint's motion, from the frame X of its body to the base.
template <class S>
TACHLESS_INLINE Motion<S> to_base(Momenta<S>& momenta, int at, const JointFrame<S>& X,
                                  const Body& body) {
  carry_one(momenta, at, X);
  const Triple<S> axis = X.R * triple(body.axis_B);
  if (body.type == JointType::revolute) return {axis, cross(X.p, axis)};
  return {zero_triple<S>(), axis};
}

/// Of a body, as in the model.
struct Coordinate {
  double multiplier;
  int coordinate;
};

}  // namespace

void Preorder::set(const std::vector<Body>& bodies) {
  const int n = static_cast<int>(bodies.size());
  for (int i = 0; i < n; ++i) size[i] = 1;
  for (int i = n - 1; i >= 0; --i) {
    if (bodies[i].parent >= 0) size[bodies[i].parent] += size[i];
  }
  int next[max_bodies], root = 0;
  for (int i = 0; i < n; ++i) {
    int& from = bodies[i].parent >= 0 ? next[bodies[i].parent] : root;
    place[i] = from;
    body[from] = i;
    next[i] = from + 1;
    from += size[i];
  }
}

ModelConstants::ModelConstants(const Model& model) : composite(model.bodies.size()) {
  for (const Body& body : model.bodies) joints.emplace_back(body);
  for (std::size_t i = 0; i < composite.size(); ++i) start(model.bodies[i], composite[i]);
  order.set(model.bodies);
}

template <class Scalar>
void set_mass_matrix(const Model& model, const JointFrame<Scalar>* frames, MatrixOf<Scalar>& M,
                     const ModelConstants* constants) {
  const int n = model.num_joints;
  const int num_bodies = static_cast<int>(model.bodies.size());
  Preorder found;
  if (constants == nullptr) found.set(model.bodies);
  const Preorder& order = constants != nullptr ? constants->order : found;

  Composite<Scalar> composite[max_bodies];
  for (int i = 0; i < num_bodies; ++i) {
    if constexpr (std::is_same_v<Scalar, double>) {
      if (constants != nullptr) {
        composite[i] = constants->composite[static_cast<std::size_t>(i)];
        continue;
      }
    }
    start(model.bodies[i], composite[i]);
  }
  const bool many = num_bodies >= many_bodies, one_to_one = num_bodies == n;
  JointFrame<Scalar> base[max_bodies];
  if (many) set_base_frames(model, frames, base);
  Coordinate coordinates[max_bodies];
  for (int i = 0; i < num_bodies; ++i) {
    coordinates[order.place[i]] = {model.bodies[i].multiplier, model.bodies[i].coordinate};
  }
  M.resize(n, n);
  std::fill_n(M.data(), n * n, Scalar(0));
  Momenta<Scalar> momenta;
  for (int k = num_bodies - 1; k >= 0; --k) {
    const Body& body = model.bodies[k];
    const Composite<Scalar>& b = composite[k];
    const bool revolute = body.type == JointType::revolute;
    const Triple<double> axis = triple(body.axis_B);
    const int begin = order.place[k], end = begin + order.size[k];
    if (revolute) {
      store(cross(axis, b.h), momenta.linear, begin);
      store(b.I * axis, momenta.angular, begin);
    } else {
      store(Triple<Scalar>{b.mass * axis.x, b.mass * axis.y, b.mass * axis.z}, momenta.linear,
            begin);
      store(cross(b.h, axis), momenta.angular, begin);
    }

    Scalar element[max_bodies];
    if (many) {
      set_power(momenta, begin, end, to_base(momenta, begin, base[k], body), element);
    } else {
      set_along(revolute ? momenta.angular : momenta.linear, begin, end, axis, element);
    }
    const int col = body.coordinate;
    for (int at = end - 1; at >= begin; --at) {
      const auto& [multiplier, row] = coordinates[at];
      element[at] = (multiplier * body.multiplier) * element[at];
      if (one_to_one) {
        M(row, col) = M(col, row) = element[at];
        continue;
      }
      M(row, col) += element[at];
      // Two bodies of one coordinate meet twice on the diagonal.
      if (row != col || at != begin) M(col, row) += element[at];
    }

    if (body.parent < 0) continue;
    const JointFrame<Scalar>& X = frames[k];
    int at = begin;
    for (; !many && at + 1 < end; at += 2) carry_two(momenta, at, X);
    if (!many && at < end) carry_one(momenta, at, X);
    add(b, X, composite[body.parent]);
  }
  if (model.rotor_inertia.size() != 0) {
    require_size(model, model.rotor_inertia.size(), "rotor_inertia");
    for (int j = 0; j < n; ++j) M(j, j) += model.rotor_inertia[j];
  }
}

template <class Scalar>
MatrixOf<Scalar> mass_matrix(const Model& model, const VectorOf<Scalar>& q) {
  JointFrame<Scalar> frames[max_bodies];
  set_joint_frames(model, q, frames);
  MatrixOf<Scalar> M;
  set_mass_matrix(model, frames, M);
  return M;
}

template MatrixOf<double> mass_matrix(const Model&, const VectorOf<double>&);
template MatrixOf<Jet2> mass_matrix(const Model&, const VectorOf<Jet2>&);
template void set_mass_matrix(const Model&, const JointFrame<double>*, MatrixOf<double>&,
                              const ModelConstants*);
template void set_mass_matrix(const Model&, const JointFrame<Jet2>*, MatrixOf<Jet2>&,
                              const ModelConstants*);

}  // namespace tachless::robot
