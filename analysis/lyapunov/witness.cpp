#include "lyapunov/witness.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <random>
#include <vector>

#include "base/failure.h"
#include "base/fnv.h"
#include "base/json_text.h"
#include "controller/registry.h"
#include "linear/scenario_loop.h"
#include "numerics/decompositions.h"
#include "robot/dynamics.h"

namespace tachless::lyapunov {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Json = nlohmann::ordered_json;

constexpr int samples = 32;  // of the ellipsoid, which is a candidate: the checker decides
constexpr int most_boxes =
    40000;  // of the checker, which says that it has not proved it beyond them
constexpr double pi = std::numbers::pi;

/// An arm with M = M[0] + M[1] cos q2 + M[2] sin q2 and g_i = (1, cos q1, sin q1) g[i] (1, cos q2,
/// sin q2)'. It has the law's numbers, and the state x = (e, v, p, t) of check_witness.py.
struct Arm {
  Vector q, kp, kd, phi, beta, D;
  std::array<MatrixXd, 3> M;
  std::vector<MatrixXd> g;
  double h = 0;

  [[nodiscard]] Index n() const { return q.size(); }
  [[nodiscard]] MatrixXd gradient(const Vector& e) const {
    const Vector at = q + e;
    const auto row = [](double x, bool derived) {
      return derived ? Eigen::RowVector3d(0, -std::sin(x), std::cos(x))
                     : Eigen::RowVector3d(1, std::cos(x), std::sin(x));
    };
    MatrixXd G(n(), n());
    for (Index i = 0; i < n(); ++i) {
      for (Index j = 0; j < n(); ++j) {
        G(i, j) = row(at[0], j == 0)
                      .dot(g[static_cast<std::size_t>(i)] *
                           row(n() == 2 ? at[1] : 0, j == 1).transpose());
      }
    }
    return G;
  }
  /// x at the next tick, of x, with inertia and Coriolis terms as at (e, v).
  [[nodiscard]] MatrixXd map(const Vector& e, const Vector& v) const {
    const Index m = n();
    const double q2 = m == 2 ? q[1] + e[1] : 0, c = std::cos(q2), s = std::sin(q2);
    const MatrixXd Mi = numerics::inverse(M[0] + c * M[1] + s * M[2]), d = c * M[2] - s * M[1];
    MatrixXd C = D.asDiagonal();
    if (m == 2) {
      C(0, 0) += d(0, 0) * v[1] / 2;
      C(0, 1) += d(0, 0) * v[0] / 2 + d(0, 1) * v[1];
      C(1, 0) -= d(0, 0) * v[0] / 2;
    }
    const MatrixXd G = gradient(e);
    MatrixXd A = MatrixXd::Zero(3 * m, 3 * m);
    A.block(0, m, m, m).setIdentity();
    A.middleRows(m, m) << -Mi * G, -Mi * C, Mi;
    const MatrixXd Phi = numerics::exponential(A * h);
    MatrixXd F = MatrixXd::Zero(4 * m, 4 * m);
    F.topLeftCorner(2 * m, 2 * m) = Phi.topLeftCorner(2 * m, 2 * m);
    F.topRightCorner(2 * m, m) = Phi.topRightCorner(2 * m, m);
    F.block(2 * m, 0, m, m) = (phi.array() - 1).cwiseProduct(beta.array()).matrix().asDiagonal();
    F.block(2 * m, 2 * m, m, m) = phi.asDiagonal();
    F.block(3 * m, 0, m, m) = G;
    F.block(3 * m, 0, m, m).diagonal() -= kp + kd.cwiseProduct(beta);
    F.block(3 * m, 2 * m, m, m) = (-kd).asDiagonal();
    return F;
  }
  /// x of a start at rest.
  [[nodiscard]] VectorXd start(Index joint, double error) const {
    VectorXd x = VectorXd::Zero(4 * n());
    x[joint] = error;
    x[2 * n() + joint] = -beta[joint] * error;
    return x;
  }
};

void require_covered(const scenario::Scenario& s, const robot::Model& model, int delay) {
  const auto& drive = s.plant.drive;
  const auto complain = [&](const char* what) {
    throw base::bad_usage(
        "{}: no witness: {}; covered: loria_ortega_rigid, one or two revolute rigid joints, one "
        "tick of delay, no dry friction, noise, torque rate limit, payload, disturbance or robot "
        "of the law's own",
        s.name, what);
  };
  if (s.controller.law != "loria_ortega_rigid") complain("another law");
  if (s.num_joints > 2) complain("more than two joints");
  if (s.robot.flexible) complain("flexible joints");
  if (std::ranges::count(model.joint_types, robot::JointType::prismatic) > 0) complain("prismatic");
  if (delay != 1) complain("the delay is not one tick");
  if (s.controller.filter_start != controller::law::FilterStart::at_error) {
    complain("the filter does not start at the error");
  }
  if (drive.dry_friction()) complain("dry friction");
  if (drive.torque_rate_limit_Nm_per_s) complain("a torque rate limit");
  if (s.plant.encoder.noise_std_rad > 0) complain("noise");
  if (!s.plant.encoder.eccentricity_rad.isZero(0)) complain("an eccentric encoder");
  if (drive.current_loop_hz || (drive.torque_scale.array() != 1).any() ||
      !drive.torque_offset_Nm.isZero(0) || drive.command_age_jitter_ticks > 0) {
    complain("a drive that lags, scales, adds torque or delays by chance");
  }
  if (s.plant.payload.mass_kg > 0 || !s.plant.disturbances.empty() || s.believed_model) {
    complain("payload, disturbance or a robot of the law's own");
  }
}

/// @throw base::Failure(bad_usage) when M or g is of another form.
Arm arm_of(const scenario::Scenario& scenario, const robot::Model& model, const Vector& q_ref,
           const controller::law::Settings& settings) {
  const auto gains = controller::gains_of<controller::law::FilterGains>(
      scenario, controller::law_facts(scenario.controller.law));
  Arm arm{q_ref,    gains.kp, gains.kd,
          gains.kp, gains.kp, scenario.plant.drive.viscous_friction_Nms_per_rad,
          {},       {},       settings.period_s};
  const Index n = arm.n();
  for (Index i = 0; i < n; ++i) {
    const auto filter =
        controller::law::filter_coefficients(settings.filter, gains.a[i], gains.b[i], arm.h);
    arm.phi[i] = filter.phi;
    arm.beta[i] = filter.beta;
  }
  const auto at = [&](double q1, double q2) {
    Vector q = Vector::Constant(n, q1);
    if (n == 2) q[1] = q2;
    return q;
  };
  const auto M = [&](double q2) -> MatrixXd { return robot::mass_matrix(model, at(0, q2)); };
  arm.M = {(M(0) + M(pi)) / 2, (M(0) - M(pi)) / 2, M(pi / 2) - (M(0) + M(pi)) / 2};
  const double size = arm.M[0].norm();
  for (MatrixXd& part : arm.M) part = (part.array().abs() < 1e-13 * size).select(0, part);
  const Eigen::Matrix3d basis = (Eigen::Matrix3d() << 1, 1, 0, 1, 0, 1, 1, -1, 0).finished();
  const MatrixXd inverse = numerics::inverse(basis);
  arm.g.assign(static_cast<std::size_t>(n), MatrixXd(3, 3));
  for (Index j = 0; j < 9; ++j) {
    const Vector g =
        robot::gravity_torque(model, at(pi / 2 * double(j / 3), pi / 2 * double(j % 3)));
    for (Index i = 0; i < n; ++i) arm.g[static_cast<std::size_t>(i)](j / 3, j % 3) = g[i];
  }
  for (MatrixXd& part : arm.g) {
    part = (inverse * part * inverse.transpose()).eval();
    part = (part.array().abs() < 1e-13 * part.norm()).select(0, part);
  }
  for (const double angle : {0.4, -1.3, 2.2}) {
    const Vector q = at(angle, 1 - 2 * angle);
    const double c = std::cos(n == 2 ? q[1] : 0), s = std::sin(n == 2 ? q[1] : 0);
    const MatrixXd off = robot::mass_matrix(model, q) - arm.M[0] - c * arm.M[1] - s * arm.M[2];
    if (off.norm() > 1e-11 * size) {
      throw base::bad_usage(
          "{}: no witness: its inertia does not depend on cos q2, sin q2 "
          "alone; covered: arms whose bodies all hang on the first joint",
          scenario.name);
    }
  }
  return arm;
}

/// Returns P of the least tr(P X) with rate² P - F' P F >= 0 for all maps F and P >= each of W, by
/// barriers. Returns nothing where there is none. Sizes of entries are about 1.
std::optional<MatrixXd> common_lyapunov(const std::vector<MatrixXd>& maps, double rate,
                                        const std::vector<MatrixXd>& W, const MatrixXd& X) {
  const Index m = X.rows(), count = m * (m + 1) / 2;
  std::vector<MatrixXd> basis;
  for (Index i = 0; i < m; ++i) {
    for (Index j = 0; j <= i; ++j) {
      MatrixXd unit = MatrixXd::Zero(m, m);
      unit(i, j) = unit(j, i) = 1;
      basis.push_back(unit);
    }
  }
  /// sum_i p_i A[i] + p_last I - offset > 0; with bounded P.
  struct Constraint {
    std::vector<MatrixXd> A;
    MatrixXd offset;
  };
  std::vector<Constraint> all;
  for (const MatrixXd& w : W) all.push_back({basis, w});
  for (const MatrixXd& F : maps) {
    all.push_back({{}, MatrixXd::Zero(m, m)});
    for (const MatrixXd& B : basis) {
      all.back().A.push_back(rate * rate * B - F.transpose() * B * F);
    }
  }
  for (Constraint& each : all) each.A.emplace_back(MatrixXd::Identity(m, m));
  all.push_back({{}, -1e6 * MatrixXd::Identity(m, m)});
  for (const MatrixXd& B : basis) all.back().A.emplace_back(-B);
  all.back().A.emplace_back(MatrixXd::Zero(m, m));

  const auto value = [](const Constraint& c, const VectorXd& p) {
    MatrixXd S = -c.offset;
    for (Index i = 0; i < p.size(); ++i) S += p[i] * c.A[static_cast<std::size_t>(i)];
    return S;
  };
  const auto inside = [&](const VectorXd& p) {
    return std::ranges::all_of(all, [&](const Constraint& c) {
      return Eigen::LLT<MatrixXd>(value(c, p)).info() == Eigen::Success;
    });
  };
  /// Newton's steps on objective / mu - sum log det; the last of p stays where `fixed`.
  const auto centre = [&](VectorXd& p, const VectorXd& objective, double mu, bool fixed) {
    const Index free = p.size() - (fixed ? 1 : 0);
    for (int step = 0; step < 15; ++step) {
      VectorXd gradient = objective.head(free) / mu;
      MatrixXd hessian = MatrixXd::Zero(free, free);
      for (const Constraint& c : all) {
        const MatrixXd inverse = numerics::inverse(value(c, p));
        MatrixXd rows(free, m * m), columns(m * m, free);
        for (Index i = 0; i < free; ++i) {
          const MatrixXd SA = inverse * c.A[static_cast<std::size_t>(i)], T = SA.transpose();
          gradient[i] -= SA.trace();
          rows.row(i) = SA.reshaped().transpose();
          columns.col(i) = T.reshaped();
        }
        hessian.noalias() += rows * columns;
      }
      const auto d = numerics::solution(hessian, -gradient);
      const double decrement = d ? -gradient.dot(d->col(0)) : 0;
      if (!(decrement > 1e-3)) return;
      VectorXd move = VectorXd::Zero(p.size());
      move.head(free) = d->col(0) * (decrement > 0.25 ? 1 / (1 + std::sqrt(decrement)) : 1);
      for (int k = 0; k < 40 && !inside(p + move); ++k) move *= 0.7;
      if (!inside(p + move)) return;
      p += move;
    }
  };
  VectorXd p = VectorXd::Zero(count + 1), objective = VectorXd::Unit(count + 1, count);
  double largest = 1, worst = 0;
  for (const MatrixXd& w : W) largest = std::max(largest, numerics::largest_eigenvalue(w));
  for (Index i = 0; i < count; ++i) {
    const MatrixXd& B = basis[static_cast<std::size_t>(i)];
    if (B.sum() == 1) p[i] = 1.1 * largest;
  }
  for (const Constraint& c : all)
    worst = std::max(worst, -numerics::smallest_eigenvalue(value(c, p)));
  p[count] = 1.5 * worst + 1;
  for (double mu = p[count]; p[count] >= 0; mu *= 0.3) {
    if (mu < 1e-9) return {};
    centre(p, objective, mu, false);
  }
  p[count] = 0;
  for (Index i = 0; i < count; ++i) {
    objective[i] = basis[static_cast<std::size_t>(i)].cwiseProduct(X).sum();
  }
  objective[count] = 0;
  const double terms = static_cast<double>(all.size()) * static_cast<double>(m);
  for (double mu = std::abs(objective.dot(p)); mu * terms > 0.01 * objective.dot(p); mu *= 0.4) {
    centre(p, objective, mu, true);
  }
  MatrixXd P = MatrixXd::Zero(m, m);
  for (Index i = 0; i < count; ++i) P += p[i] * basis[static_cast<std::size_t>(i)];
  return P;
}

/// P with V <= 1 at the errors, and as near to it as some trials come; nothing where none is found.
/// @param limit of |t| [N m]
std::optional<MatrixXd> found(const Arm& arm, const Vector& errors, const Vector& limit) {
  const Index n = arm.n(), size = 4 * n;
  const MatrixXd at_rest = arm.map(Vector::Zero(n), Vector::Zero(n));
  const double radius = numerics::eigenvalues(at_rest).cwiseAbs().maxCoeff();
  VectorXd scale = VectorXd::Zero(size);  // what x reaches in the linear loop
  for (Index i = 0; i < n; ++i) {
    VectorXd x = arm.start(i, errors[i]);
    for (int k = 0; k < 400; ++k, x = at_rest * x) scale = scale.cwiseMax(x.cwiseAbs());
  }
  const MatrixXd inverse_scale = scale.cwiseInverse().asDiagonal();
  MatrixXd X = MatrixXd::Zero(size, size);
  for (Index i = 0; i < n; ++i) {
    const VectorXd x = inverse_scale * arm.start(i, errors[i]);
    X += x * x.transpose();
  }
  std::vector<MatrixXd> W(1);
  for (Index i = 0; i < n; ++i) {
    const Index at = 3 * n + i;
    W.emplace_back(MatrixXd::Zero(size, size));
    if (std::isfinite(limit[i])) W.back()(at, at) = std::pow(scale[at] / limit[i], 2);
  }
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  std::vector<VectorXd> directions = {VectorXd::Zero(2 * n)};
  for (int k = 0; k < samples; ++k) {
    VectorXd z(2 * n);
    for (double& each : z) each = normal(random);
    directions.push_back(z.normalized());
  }
  // The decay asked of V, as a share of what the slowest mode has.
  for (const double share : {0.5, 0.25, 0.1}) {
    double factor = 2;  // of what (e, v) reaches: the ellipsoid's
    for (int trial = 0; trial < 6; ++trial) {
      const VectorXd reach = factor * scale.head(2 * n);
      std::vector<MatrixXd> maps;
      for (const VectorXd& z : directions) {
        const VectorXd at = reach.cwiseProduct(z);
        maps.push_back(inverse_scale * arm.map(at.head(n), at.tail(n)) * scale.asDiagonal());
      }
      W[0] = MatrixXd::Zero(size, size);
      W[0].diagonal().head(2 * n).setConstant(1 / (factor * factor));
      const auto P = common_lyapunov(maps, 1 - share * (1 - radius), W, X);
      if (!P) break;
      double largest = 0;
      for (Index i = 0; i < n; ++i) {
        const VectorXd x = inverse_scale * arm.start(i, errors[i]);
        largest = std::max(largest, x.dot(*P * x));
      }
      // The ellipsoid contains the starts, with at most 7 % of V to spare: a larger one is harder
      // to prove. The next one is 1.5 % wider than these starts ask for.
      if (largest <= 1 && largest > 0.93) return inverse_scale * *P * inverse_scale;
      factor *= 1.015 * std::sqrt(largest);
    }
  }
  return {};
}

Json json_of(const MatrixXd& A) {
  Json rows = Json::array();
  for (Index i = 0; i < A.rows(); ++i) {
    rows.push_back(base::json_list(A.row(i)));
  }
  return rows;
}
Json json_of(const Vector& x) { return base::json_list(x); }

}  // namespace

std::string witness(const scenario::Scenario& scenario, const Vector& errors) {
  const robot::Model model = linear::plant_of(scenario);
  const linear::ScenarioLoop loop(scenario);
  require_covered(scenario, model, loop.settings().command_delay);
  const Arm arm = arm_of(scenario, model, loop.rest_at(0).q_ref, loop.settings());
  const Index n = arm.n();
  Vector limit = Vector::Constant(n, infinity), quantum = Vector::Zero(n);
  if (const auto& given = scenario.plant.drive.torque_limit_Nm) {
    const Vector gravity = robot::gravity_torque(model, arm.q).cwiseAbs();
    limit = *given - gravity;
    for (Index i = 0; i < n; ++i) {
      if (limit[i] > 0) continue;
      throw base::bad_usage(
          "{}: gravity alone takes {:.4g} of the {:.4g} N m that plant.drive.torque_limit_Nm gives "
          "joint {}; allowed: a reference whose posture leaves some",
          scenario.name, gravity[i], (*given)[i], i + 1);
    }
  }
  if (const auto& bits = scenario.plant.encoder.resolution_bits) {
    for (Index i = 0; i < n; ++i) quantum[i] = (1 + 1e-9) * pi * std::exp2(-(*bits)[i]);
  }
  const auto P = found(arm, errors, 0.999 * limit);
  if (!P) {
    throw base::bad_usage("{}: no witness was found for these errors; try smaller ones",
                          scenario.name);
  }
  const MatrixXd L = Eigen::LLT<MatrixXd>(*P).matrixL();
  double gamma = 0;  // of the rounding of angles
  const MatrixXd F = arm.map(Vector::Zero(n), Vector::Zero(n));
  for (Index i = 0; i < n; ++i) {
    VectorXd column = F.col(i);
    column.head(2 * n).setZero();
    gamma += 1.02 * quantum[i] * (L.transpose() * column).norm();
  }
  Json json = {{"checksum", ""},
               {"scenario", scenario.name},
               {"joints", n},
               {"period_s", arm.h},
               {"q_ref", json_of(arm.q)},
               {"kp", json_of(arm.kp)},
               {"kd", json_of(arm.kd)},
               {"phi", json_of(arm.phi)},
               {"beta", json_of(arm.beta)},
               {"viscous", json_of(arm.D)},
               {"M", Json::array()},
               {"g", Json::array()},
               {"quantum", json_of(quantum)},
               {"torque_limit", nullptr},
               {"rho", 1 - std::max(1e-3, 2 * gamma)},
               {"gamma", gamma},
               {"boxes", most_boxes},
               {"L", json_of(L)}};
  for (const MatrixXd& part : arm.M) json["M"].push_back(json_of(part));
  for (const MatrixXd& part : arm.g) json["g"].push_back(json_of(part));
  if (const auto& given = scenario.plant.drive.torque_limit_Nm) {
    // JSON has no infinity.
    json["torque_limit"] = json_of(Vector(given->cwiseMin(std::numeric_limits<double>::max())));
  }
  // The checksum is that of the text whose checksum is empty.
  json["checksum"] = fmt::format("{:016x}", base::fnv(base::json_text(json, 1) + "\n"));
  return base::json_text(json, 1) + "\n";
}

}  // namespace tachless::lyapunov
