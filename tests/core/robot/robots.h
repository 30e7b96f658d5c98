#pragma once

#include <cmath>
#include <fstream>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>

#include "robot/jet.h"
#include "robot/kinematics.h"
#include "robot/model.h"

namespace tachless::robot {

inline Jet2 sin(const Jet2& x) {
  Jet2 s, c;
  sin_cos(x, s, c);
  return s;
}
inline Jet2 cos(const Jet2& x) {
  Jet2 s, c;
  sin_cos(x, s, c);
  return c;
}

/// Position of a URDF link's origin in the root link's frame [m].
inline Eigen::Vector3d link_position(const Model& model, const std::string& link, const Vector& q) {
  return frame_pose(model, link, q).p;
}

}  // namespace tachless::robot

/// Robots, motions and random states that these tests share.
namespace tachless::robot::testing {

inline std::string read_text(const std::string& path) {
  std::ifstream in(path);
  if (!in) throw std::runtime_error("cannot read " + path);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

inline Model load(const std::string& path_in_repository) {
  const std::string path = std::string(TACHLESS_SOURCE_DIR) + "/" + path_in_repository;
  return model_from_urdf(read_text(path), path);
}

inline Model two_link(double payload_mass = 0) {
  return with_payload(load("scenarios/robots/two_link.urdf"), {.mass = payload_mass});
}
inline Model iiwa7() { return load("scenarios/robots/iiwa7.urdf"); }
/// Branches, a prismatic joint, mimics of both kinds, an inclined axis, merged links.
inline Model branching() { return load("tests/core/robot/branching.urdf"); }

/// A zig-zag chain of `n` revolute joints, each of whose links is light and short, so that the
/// numbers stay of order one; `mimics` further joints at its end turn with the first.
inline std::string chain_urdf(int n, int mimics = 0) {
  std::ostringstream out;
  out << "<robot name='chain'><link name='l0'/>";
  for (int i = 1; i <= n + mimics; ++i) {
    out << "<joint name='j" << i << "' type='continuous'><parent link='l" << i - 1
        << "'/><child link='l" << i << "'/><origin xyz='0.1 0.02 0.05' rpy='0.3 " << 0.1 * (i % 7)
        << " 0.2'/><axis xyz='" << i % 3 << " 1 " << i % 2 << "'/>";
    if (i > n) out << "<mimic joint='j1' multiplier='0.5'/>";
    out << "</joint><link name='l" << i
        << "'><inertial><origin xyz='0.05 0 0.01'/><mass value='0.5'/><inertia ixx='0.02' "
           "iyy='0.03' izz='0.025' ixy='0.001' ixz='0' iyz='0.002'/></inertial></link>";
  }
  out << "</robot>";
  return out.str();
}

/// The closed form of the two-link arm (scenarios/robots/two_link.urdf, its comment).
struct TwoLinkClosedForm {
  double mp = 0;
  double g0 = 9.81;
  double h() const { return 0.51 + mp; }

  template <class Scalar>
  MatrixOf<Scalar> M(const VectorOf<Scalar>& q) const {
    using std::cos;
    const double d11 = 8.77 + 2 * mp, d12 = 0.76 + mp, d22 = 0.62 + mp;
    const Scalar c = h() * cos(q[1]);
    MatrixOf<Scalar> m(2, 2);
    m(0, 0) = d11 + 2.0 * c;
    m(0, 1) = m(1, 0) = d12 + c;
    m(1, 1) = Scalar(d22);
    return m;
  }
  template <class Scalar>
  MatrixOf<Scalar> C(const VectorOf<Scalar>& q, const VectorOf<Scalar>& v) const {
    using std::sin;
    const Scalar s = h() * sin(q[1]);
    MatrixOf<Scalar> c(2, 2);
    c(0, 0) = -s * v[1];
    c(0, 1) = -s * (v[0] + v[1]);
    c(1, 0) = s * v[0];
    c(1, 1) = Scalar(0);
    return c;
  }
  template <class Scalar>
  VectorOf<Scalar> g(const VectorOf<Scalar>& q) const {
    using std::sin;
    const double g1 = 7.6 + mp, g2 = 0.63 + mp;
    VectorOf<Scalar> out(2);
    out[1] = (g0 * g2) * sin(q[0] + q[1]);
    out[0] = (g0 * g1) * sin(q[0]) + out[1];
    return out;
  }
};

/// `frame_pose` with its rate at velocity `v`.
inline Pose<Jet2> moving_pose(const Model& model, const Frame& frame, const Vector& q,
                              const Vector& v) {
  const JetVector along = jet(q, v, Vector::Zero(q.size()));
  Pose<Jet2> X{frame.R_BF.cast<Jet2>(), frame.p_BF.cast<Jet2>()};
  for (int i = frame.body; i >= 0; i = model.bodies[i].parent) {
    X = joint_pose(model.bodies[i], along) * X;
  }
  return X;
}

/// Uniform vectors from a fixed seed.
class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return low + (high - low) * (engine_() / 4294967296.0);
  }
  Vector vector(Eigen::Index n, double scale) {
    Vector x(n);
    for (Eigen::Index i = 0; i < n; ++i) x[i] = uniform(-scale, scale);
    return x;
  }

 private:
  std::mt19937 engine_;
};

}  // namespace tachless::robot::testing
