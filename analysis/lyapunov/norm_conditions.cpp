#include "lyapunov/norm_conditions.h"

#include <algorithm>
#include <cmath>

#include "linear/linear_loop.h"
#include "numerics/decompositions.h"
#include "numerics/golden_section.h"
#include "robot/dynamics.h"

namespace tachless::lyapunov {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Returns sup over |x| = 1 of the norm of sum_j x_j C_j, the largest value of the trilinear form
/// u'C(x)w on unit vectors. Alternating power iteration from several directions approaches it from
/// below.
double largest_over_directions(const std::vector<MatrixXd>& C) {
  const auto n = static_cast<Eigen::Index>(C.size());
  double best = 0;
  for (Eigen::Index start = 0; start < n; ++start) {
    VectorXd x = VectorXd::Unit(n, start) + VectorXd::Constant(n, 0.1);
    VectorXd w = VectorXd::LinSpaced(n, 1, 0.3);  // along no eigenvector in particular
    double value = 0;
    for (int iteration = 0; iteration < 300; ++iteration) {
      MatrixXd sum = MatrixXd::Zero(n, n);
      for (Eigen::Index j = 0; j < n; ++j) sum += x[j] * C[static_cast<std::size_t>(j)];
      w.noalias() = (sum.transpose() * (sum * w)).eval();
      if (!(w.norm() > 0)) break;
      w.normalize();
      const VectorXd u = (sum * w).normalized();
      for (Eigen::Index j = 0; j < n; ++j) x[j] = u.dot(C[static_cast<std::size_t>(j)] * w);
      const double norm = x.norm();  // u'C(x)w at the best x
      if (!(norm > 0)) break;
      x /= norm;
      if (norm <= value * (1 + 1e-13)) break;
      value = norm;
    }
    best = std::max(best, value);
  }
  return best;
}

/// Smallest and largest eigenvalue, the paper's lambda and Lambda.
struct Spread {
  double min = 0, max = 0;
};
Spread spread(const VectorXd& diagonal) { return {diagonal.minCoeff(), diagonal.maxCoeff()}; }
Spread spread(const MatrixXd& symmetric) {
  return {numerics::smallest_eigenvalue(symmetric), numerics::largest_eigenvalue(symmetric)};
}

struct Spreads {
  Spread kp, kd, a, b, M;
  Spread kd_by_b, kd_by_b_a;  // Kd B^-1, Kd B^-1 A

  Spreads(const ErrorSystem& s, const RobotConstants& c)
      : kp(spread(s.kp)),
        kd(spread(s.kd)),
        a(spread(s.a)),
        b(spread(s.b)),
        M{c.lambda_min_M.value, c.lambda_max_M.value},
        kd_by_b(spread(s.kd_by_b())),
        kd_by_b_a(spread(MatrixXd(s.kd_by_b() * s.a.asDiagonal()))) {
    if (s.rotor_inertia.size() > 0) {
      M.min = std::min(M.min, s.rotor_inertia.minCoeff());
      M.max = std::max(M.max, s.rotor_inertia.maxCoeff());
    }
  }
};

}  // namespace

RobotConstants robot_constants(const robot::Model& model) {
  const auto over_postures = [&](int samples, const auto& value) {
    return numerics::largest(
        model, [&](const Vector& q) { return value(q); }, samples);
  };
  RobotConstants c;
  c.lambda_max_M = over_postures(2048, [&](const Vector& q) {
    return numerics::largest_eigenvalue(robot::mass_matrix(model, q));
  });
  c.lambda_min_M = over_postures(2048, [&](const Vector& q) {
    return -numerics::smallest_eigenvalue(robot::mass_matrix(model, q));
  });
  c.lambda_min_M.value *= -1;
  c.k_c = over_postures(256, [&](const Vector& q) {
    return largest_over_directions(numerics::inertia_at(model, q).C);
  });
  c.k_g = over_postures(1024, [&](const Vector& q) {
    return numerics::spectral_norm(linear::gradient_by_q(model, linear::constant_reference(q)));
  });
  return c;
}

PrintedConditions printed_conditions(const ErrorSystem& system, const RobotConstants& constants,
                                     double B_d) {
  const Spreads s(system, constants);
  const double k_c = constants.k_c.value;
  // The product is symmetric: Kd is diagonal, or a and b are the same in all joints.
  const auto kd_by = [&](const VectorXd& factors) {
    return spread(MatrixXd(system.kd * factors.asDiagonal()));
  };
  PrintedConditions c;
  c.eq7 = s.M.max / s.M.min;
  c.eq19 = 0.5 * std::sqrt(s.kp.min / (2 * s.M.max));
  c.eq20 = 0.5 * std::sqrt(s.kd_by_b.min / (2 * s.M.max));
  c.eq23 = 2 * s.kp.min * s.kd_by_b_a.min / std::pow(s.kp.max + s.kd.max, 2);
  c.eq24 = 2 * (kd_by(system.a.cwiseProduct(system.b)).min / s.b.max) * s.M.min /
           std::pow(s.a.max * s.M.max, 2);
  c.eq25 = k_c * B_d / (s.b.min * s.M.min);
  c.eq27 = 0.5 * (kd_by(system.a).min / kd_by(system.b).max);

  constexpr double gamma_1 = 0.5;  // as gamma_2 is printed in (27)
  // With eps given, the smallest beta_3 and beta_1 leave the most for beta_2.
  const auto beta_2 = [&](double eps) { return 1 - eps / (c.eq24 * gamma_1) - c.eq25 / eps; };
  const auto R = [&](double eps) {
    return (beta_2(eps) * s.b.min * s.M.min - s.M.max) / (2 * k_c);
  };
  const auto c1 = [&](double eps) {
    const double alpha_1 = std::min({s.kp.min, s.kd_by_b.min, s.M.min}) / 4;
    const double alpha_2 = std::max({(eps * s.M.max + s.kp.max) / 2, (eps + 0.5) * s.M.max,
                                     (eps * s.M.max + s.kd_by_b.max) / 2});
    return R(eps) * std::sqrt(alpha_1 / alpha_2);
  };
  const double high = std::min({c.eq19, c.eq20, c.eq23 * gamma_1, c.eq27});
  if (!(c.eq25 < high)) return c;
  // R is concave in eps, with its maximum where the two shares are equal.
  const double low = std::max(c.eq25, 1e-9 * high);  // eq25 may be 0
  const double top = std::clamp(std::sqrt(c.eq25 * c.eq24 * gamma_1), low, high);
  const auto positive = [&](double eps) { return R(eps) > 0; };
  c.feasible = positive(top);
  if (!c.feasible) return c;
  c.epsilon = {linear::edge(top, c.eq25, 60, positive), linear::edge(top, high, 60, positive)};
  if (c.eq25 == 0) c.epsilon.low = 0;  // beta_2 falls with eps then
  // On a logarithmic scale, on which both ends are as near.
  const double best = std::exp(
      numerics::largest_between([&](double log_eps) { return c1(std::exp(log_eps)); },
                                std::log(std::max(c.epsilon.low, low)), std::log(c.epsilon.high)));
  c.c1 = c1(best);
  c.eq26 = R(best);
  return c;
}

}  // namespace tachless::lyapunov
