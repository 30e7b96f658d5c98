#include "lyapunov/proved_form.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "lyapunov/error_system.h"
#include "numerics/decompositions.h"
#include "robot/dynamics.h"

namespace tachless::lyapunov {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The square root of the sum of A_j^2 bounds sum x_j A_j, |x| <= 1, from both sides. It is taken
/// after the congruence by L.
MatrixXd bound_of(const std::vector<MatrixXd>& all, const MatrixXd& L) {
  const auto lower = L.triangularView<Eigen::Lower>();
  MatrixXd sum = MatrixXd::Zero(L.rows(), L.cols());
  for (const MatrixXd& A : all) {
    const MatrixXd left = lower.solve(A), white = lower.solve(left.transpose());
    sum += symmetric_part(white) * symmetric_part(white);
  }
  const auto [values, vectors] = numerics::symmetric_eigen(sum);
  return L * vectors * values.cwiseMax(0).cwiseSqrt().asDiagonal() * vectors.transpose() *
         L.transpose();
}

/// Mm of a loop and given weights over the postures.
class Proof {
 public:
  Proof(const BoundedForm& loop, const numerics::Postures& postures, const FormWeights& weights)
      : loop_(loop),
        postures_(postures),
        weights_(weights),
        m_(weights.P.rows()),
        n_(weights.N.rows()),
        of_delta_(delta_norm(weights)) {
    const MatrixXd zero = MatrixXd::Zero(n_, n_);
    nothing_ = decrease(zero, zero);
    find_slack();
    find_shares();
  }

  [[nodiscard]] FormRegion region() const {
    return region_of(base::parallel_map(postures_.inertia.size(), [&](std::size_t k) {
      const numerics::Inertia& inertia = postures_.inertia[k];
      FormResult at;
      at.w = largest_share(inertia);
      const auto Mm = smallest_decrease(inertia);
      if (!Mm || std::isinf(at.w)) return at;
      at.rho = rho_at(*Mm, inertia);
      at.rate = rate_at(*Mm, inertia);
      return at;
    }));
  }

 private:
  [[nodiscard]] MatrixXd decrease(const MatrixXd& M, const MatrixXd& Cd) const {
    ErrorForm form = loop_.constant;
    form.M = M;
    form.Cd = Cd;
    return decrease_matrix(form, weights_);
  }
  /// Returns the parts of Mm that are linear in M and in Cd.
  [[nodiscard]] MatrixXd of_inertia(const MatrixXd& M) const {
    return decrease(M, MatrixXd::Zero(n_, n_)) - nothing_;
  }
  [[nodiscard]] MatrixXd of_coriolis(const MatrixXd& Cd) const {
    return decrease(MatrixXd::Zero(n_, n_), Cd) - nothing_;
  }

  /// Bounds the parts of M, Mm and sym C(q, delta) that are missing between two postures.
  void find_slack() {
    const numerics::Inertia& first = postures_.inertia[0];
    const MatrixXd scale_M = first.M.diagonal().cwiseSqrt().asDiagonal();
    const VectorXd size = decrease(first.M, MatrixXd::Zero(n_, n_)).diagonal().cwiseAbs();
    const MatrixXd scale = size.cwiseMax(1e-9 * size.maxCoeff()).cwiseSqrt().asDiagonal();
    slack_M_ = slack_delta_ = MatrixXd::Zero(n_, n_);
    slack_ = MatrixXd::Zero(m_ + n_, m_ + n_);
    for (const numerics::Postures::Harmonic& h : postures_.harmonics) {
      const double curvature = postures_.chord_factor * h.order * h.order;
      std::vector<MatrixXd> of_v, of_delta;
      for (const numerics::Inertia* part : {&h.cosine, &h.sine}) {
        for (const MatrixXd& C : numerics::coriolis_along(part->C, loop_.v_scale)) {
          of_v.push_back(of_coriolis(C));
        }
        for (const MatrixXd& C : numerics::coriolis_along(part->C, of_delta_)) {
          of_delta.push_back(symmetric_part(C));
        }
      }
      slack_M_ += curvature * bound_of({h.cosine.M, h.sine.M}, scale_M);
      slack_ += curvature * bound_of({of_inertia(h.cosine.M), of_inertia(h.sine.M)}, scale);
      if (!of_v.empty()) slack_ += curvature * bound_of(of_v, scale);
      slack_delta_ += curvature * bound_of(of_delta, scale_M);
    }
  }

  /// Returns Z of the power (Z' x)' d in Vdot.
  [[nodiscard]] MatrixXd inlet(const MatrixXd& M) const {
    MatrixXd Z(m_ + n_, n_);
    Z << weights_.P * loop_.E + weights_.N.transpose() * loop_.F,
        M * weights_.N * loop_.E + loop_.F;
    return Z;
  }

  /// Chooses s_i of z_i d_i <= s_i/2 z_i^2 + d_i^2 / (2 s_i), so that both parts are alike.
  void find_shares() {
    shares_ = VectorXd::Ones(n_);
    const MatrixXd& M = postures_.inertia[0].M;
    const Eigen::LLT<MatrixXd> Mm(decrease(M, MatrixXd::Zero(n_, n_)));
    if (Mm.info() != Eigen::Success) return;
    const MatrixXd Z = inlet(M);
    const VectorXd inverse = Mm.solve(MatrixXd::Identity(m_ + n_, m_ + n_)).diagonal();
    for (Index i = 0; i < n_; ++i) {
      const VectorXd row = loop_.most.row(i);
      const double of_z = Z.col(i).dot(Mm.solve(Z.col(i)));
      const double of_d = row.sum() * row.dot(inverse);
      if (of_z > 0 && of_d > 0) shares_[i] = std::sqrt(of_d / of_z);
    }
  }

  /// Returns a bound of sym(Z d') from above, at the posture and up to the next one.
  [[nodiscard]] MatrixXd of_bounds(const MatrixXd& M) const {
    constexpr double more = 1e-3;  // (z + dz)^2 <= (1 + t) z^2 + (1 + 1/t) dz^2
    const MatrixXd Z = inlet(M), change = weights_.N * loop_.E;
    const double most = numerics::spectral_norm(slack_M_);
    MatrixXd sum = MatrixXd::Zero(m_ + n_, m_ + n_);
    for (Index i = 0; i < n_; ++i) {
      const VectorXd row = loop_.most.row(i);
      if (row.isZero(0)) continue;
      const double s = shares_[i] / 2;
      sum += s * (1 + more) * Z.col(i) * Z.col(i).transpose();
      sum.diagonal().tail(n_).array() +=
          s * (1 + 1 / more) * most * most * change.col(i).squaredNorm();
      // (sum r_k |x_k|)^2 <= sum r_k sum r_k x_k^2
      sum.diagonal() += row.sum() / (4 * s) * row;
    }
    return sum;
  }

  /// Returns a matrix below Mm at delta = 0 for every v_ref and d, if it is positive definite.
  [[nodiscard]] std::optional<MatrixXd> smallest_decrease(const numerics::Inertia& inertia) const {
    const MatrixXd at_rest =
        decrease(inertia.M, MatrixXd::Zero(n_, n_)) - slack_ - of_bounds(inertia.M);
    const Eigen::LLT<MatrixXd> llt(at_rest);
    if (llt.info() != Eigen::Success) return {};
    std::vector<MatrixXd> of_v;
    for (const MatrixXd& C : numerics::coriolis_along(inertia.C, loop_.v_scale)) {
      of_v.push_back(of_coriolis(C));
    }
    if (of_v.empty()) return at_rest;
    MatrixXd least = at_rest - bound_of(of_v, llt.matrixL());
    if (Eigen::LLT<MatrixXd>(least).info() != Eigen::Success) return {};
    return least;
  }

  [[nodiscard]] double rho_at(const MatrixXd& Mm, const numerics::Inertia& inertia) const {
    constexpr double strictly_below = 1 - 1e-9;
    const MatrixXd E = MatrixXd::Identity(m_ + n_, m_ + n_).rightCols(n_);
    const MatrixXd H =
        Eigen::LLT<MatrixXd>(Eigen::LLT<MatrixXd>(Mm).solve(E).bottomRows(n_)).matrixL();
    MatrixXd sum = MatrixXd::Zero(n_, n_);
    for (const MatrixXd& C : numerics::coriolis_along(inertia.C, of_delta_)) {
      const MatrixXd scaled = H.transpose() * symmetric_part(C) * H;
      sum += scaled * scaled;
    }
    const double most = std::sqrt(std::max(0.0, numerics::largest_eigenvalue(sum))) +
                        numerics::largest_eigenvalue(H.transpose() * slack_delta_ * H);
    return strictly_below / std::max(most, 1e-300);
  }

  /// Returns the decay of V for small errors.
  [[nodiscard]] double rate_at(const MatrixXd& Mm, const numerics::Inertia& inertia) const {
    ErrorForm form = loop_.constant;
    form.M = inertia.M;
    MatrixXd V = lyapunov_matrix(form, weights_);
    const double more = numerics::spectral_norm(slack_M_);
    V.diagonal().array() += more * (1 + numerics::spectral_norm(weights_.N));
    const MatrixXd half =
        Eigen::LLT<MatrixXd>(V).matrixL().solve(MatrixXd(Eigen::LLT<MatrixXd>(Mm).matrixL()));
    return 2 * numerics::smallest_eigenvalue(half * half.transpose());
  }

  /// Returns the largest |L^-1 delta|^2 of V = 1/2; infinity where V is not positive definite. S is
  /// antitone in M and its inverse is convex, so that the ends of a chord bound it.
  [[nodiscard]] double largest_share(const numerics::Inertia& inertia) const {
    const MatrixXd M = inertia.M + slack_M_;
    const Eigen::LLT<MatrixXd> S(weights_.P - weights_.N.transpose() * M * weights_.N);
    const Eigen::LLT<MatrixXd> least(inertia.M - slack_M_);
    if (S.info() != Eigen::Success || least.info() != Eigen::Success) return infinity;
    const MatrixXd N = of_delta_.triangularView<Eigen::Lower>().solve(weights_.N);
    return numerics::largest_eigenvalue(N * S.solve(N.transpose()));
  }

  const BoundedForm& loop_;
  const numerics::Postures& postures_;
  const FormWeights& weights_;
  Index m_, n_;
  MatrixXd of_delta_;  ///< L of |L^-1 delta|
  MatrixXd nothing_;   ///< Mm without M and Cd
  MatrixXd slack_M_, slack_, slack_delta_;
  VectorXd shares_;
};

using Pair = std::array<Vector, 2>;  ///< of v and a

/// Largest derivatives by the positions, over a grid of postures: first and second ones of a
/// torque.
struct Derivatives {
  MatrixXd first;                  ///< by q_j
  std::array<MatrixXd, 2> second;  ///< by q_l, q_j

  void include(const Derivatives& other) {
    first = first.cwiseMax(other.first.cwiseAbs());
    for (std::size_t l = 0; l < 2; ++l) {
      second[l] = second[l].cwiseMax(other.second[l].cwiseAbs());
    }
  }
  Derivatives& operator+=(const Derivatives& other) {
    first += other.first;
    for (std::size_t l = 0; l < 2; ++l) second[l] += other.second[l];
    return *this;
  }
  [[nodiscard]] Derivatives times(double s) const {
    return {s * first, {s * second[0], s * second[1]}};
  }
};

/// Returns the derivatives of ID(q, v, a) by q at a posture, exact to rounding.
Derivatives derivatives(const robot::Model& model, const Vector& q, const Pair& va) {
  const Vector none = Vector::Zero(2);
  const auto along = [&](double first, double second) {
    Vector d(2);
    d << first, second;
    return robot::inverse_dynamics(model, robot::jet(q, d, none), robot::jet(va[0], none, none),
                                   robot::jet(va[1], none, none));
  };
  const auto x = along(1, 0), y = along(0, 1), both = along(1, 1);
  const Vector xx = robot::second_derivative(x), yy = robot::second_derivative(y);
  const Vector xy = (robot::second_derivative(both) - xx - yy) / 2;
  Derivatives result{MatrixXd(2, 2), {MatrixXd(2, 2), MatrixXd(2, 2)}};
  result.first << robot::first_derivative(x), robot::first_derivative(y);
  result.second[0] << xx, xy;
  result.second[1] << xy, yy;
  return result;
}

/// Returns after how many turns of two joints every body is where it began; nothing where a body
/// turns by more than its joint, or slides, or after more than 8 turns.
std::optional<int> turns_of(const robot::Model& model) {
  const bool revolute = std::ranges::all_of(model.bodies, [](const robot::Body& body) {
    return body.type == robot::JointType::revolute;
  });
  const int turns = numerics::multiplier_denominator(model);
  if (model.num_joints != 2 || !revolute || turns == 0 ||
      numerics::most_turns(model).maxCoeff() > 1)
    return {};
  return turns;
}

}  // namespace

FormRegion proved_region(const BoundedForm& loop, const numerics::Postures& postures,
                         const FormWeights& weights) {
  return Proof(loop, postures, weights).region();
}

std::optional<TorqueGradients> torque_gradients(const robot::Model& model, const Vector& v,
                                                const Vector& a, const Vector& jerk) {
  const auto turns = turns_of(model);
  if (!turns) return {};
  // The torques are trigonometric polynomials of degree 2 in each position. With N points a turn
  // their largest value is at most that of the grid over cos(pi 2 / N), for each of the positions.
  constexpr int per_turn = 64;
  const int points = *turns * per_turn;
  const double step = 2 * std::numbers::pi / per_turn, beyond = std::pow(std::cos(step), -2);
  robot::Model floating = model;
  floating.gravity.setZero();
  const Vector none = Vector::Zero(2);
  const auto unit = [](Eigen::Index i) { return Vector(Vector::Unit(2, i)); };
  const MatrixXd zero = MatrixXd::Zero(2, 2);
  const Derivatives nothing{zero, {zero, zero}};
  // Sums of |v|, |a| and |jerk| times the largest derivatives of g, M e_k and C(q, e_k) e_l.
  Derivatives g = nothing, sum = nothing;
  std::array<Derivatives, 2> M = {nothing, nothing};
  std::array<Derivatives, 3> c = {nothing, nothing, nothing};  // of (0, 0), (1, 1), (0, 1)
  for (int k = 0; k < points * points; ++k) {
    Vector q(2);
    q << step * (k / points), step * (k % points);
    g.include(derivatives(model, q, {none, none}));
    for (std::size_t i = 0; i < 2; ++i) {
      M[i].include(derivatives(floating, q, {none, unit(static_cast<Eigen::Index>(i))}));
    }
    const Derivatives first = derivatives(floating, q, {unit(0), none});
    const Derivatives second = derivatives(floating, q, {unit(1), none});
    Derivatives mixed = derivatives(floating, q, {Vector(unit(0) + unit(1)), none});
    mixed += first.times(-1);
    mixed += second.times(-1);
    c[0].include(first);
    c[1].include(second);
    c[2].include(mixed);  // twice C(q, e_0) e_1
  }
  const std::array<double, 3> vv = {v[0] * v[0], v[1] * v[1], v[0] * v[1]};
  const std::array<double, 3> va = {2 * v[0] * a[0], 2 * v[1] * a[1], v[0] * a[1] + v[1] * a[0]};
  sum += g;
  TorqueGradients result{zero, zero};
  for (std::size_t k = 0; k < 2; ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    sum += M[k].times(a[i]);
    result.of_rate += jerk[i] * M[k].first;
  }
  for (std::size_t k = 0; k < 3; ++k) {
    sum += c[k].times(vv[k]);
    result.of_rate += va[k] * c[k].first;
  }
  result.of_torque = beyond * sum.first;
  result.of_rate = beyond * (result.of_rate + v[0] * sum.second[0] + v[1] * sum.second[1]);
  return result;
}

}  // namespace tachless::lyapunov
