#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>
#include <fstream>
#include <random>
#include <sstream>
#include <stdexcept>

#include "messages/signals.h"
#include "robot/model.h"

/// The paper's two-link arm (Berghuis and Nijmeijer 1992) in closed form. It is written apart from
/// robot/, as a reference for the laws' tests.
namespace tachless::controller::law {

template <class Scalar>
struct TwoLink {
  using Pair = Eigen::Matrix<Scalar, 2, 1>;
  using Square = Eigen::Matrix<Scalar, 2, 2>;

  Scalar payload = 0;  ///< [kg]

  [[nodiscard]] Square M(const Pair& q) const {
    using std::cos;
    const Scalar c = h() * cos(q[1]);
    const Scalar d12 = Scalar(76) / 100 + payload;
    Square m;
    m << Scalar(877) / 100 + 2 * payload + 2 * c, d12 + c, d12 + c, Scalar(62) / 100 + payload;
    return m;
  }
  [[nodiscard]] Square C(const Pair& q, const Pair& v) const {
    using std::sin;
    const Scalar s = h() * sin(q[1]);
    Square c;
    c << -s * v[1], -s * (v[0] + v[1]), s * v[0], Scalar(0);
    return c;
  }
  [[nodiscard]] Pair g(const Pair& q) const {
    using std::sin;
    const Scalar g0 = 981 / Scalar(100);
    const Scalar far = g0 * (Scalar(63) / 100 + payload) * sin(q[0] + q[1]);
    return {g0 * (Scalar(76) / 10 + payload) * sin(q[0]) + far, far};
  }
  /// Returns M a + C(q, x) y + g.
  [[nodiscard]] Pair torque(const Pair& q, const Pair& x, const Pair& y, const Pair& a) const {
    return M(q) * a + C(q, x) * y + g(q);
  }
  [[nodiscard]] Pair acceleration(const Pair& q, const Pair& v, const Pair& tau) const {
    return M(q).inverse() * (tau - C(q, v) * v - g(q));
  }

 private:
  [[nodiscard]] Scalar h() const { return Scalar(51) / 100 + payload; }
};

using Pair = Eigen::Vector2d;

inline Vector vector(double x, double y) {
  Vector v(2);
  v << x, y;
  return v;
}

/// Returns the same arm as a model of `robot/`.
inline const robot::Model& two_link_model() {
  static const robot::Model model = [] {
    const std::string path = TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf";
    std::ifstream file(path);
    if (!file) {
      throw std::runtime_error("cannot read " + path);
    }
    std::stringstream text;
    text << file.rdbuf();
    return robot::model_from_urdf(text.str(), path);
  }();
  return model;
}

/// Random vectors with a fixed seed.
class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}

  Vector pair(double size) { return vector(between(-size, size), between(-size, size)); }
  Vector positive(double least, double most) {
    return vector(between(least, most), between(least, most));
  }
  double between(double least, double most) {
    return std::uniform_real_distribution<double>(least, most)(engine_);
  }
  messages::ReferencePoint reference() {
    return {pair(2), pair(2), pair(20), pair(100), pair(1000)};
  }

 private:
  std::mt19937 engine_;
};

}  // namespace tachless::controller::law
