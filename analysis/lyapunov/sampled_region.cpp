#include "lyapunov/sampled_region.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "controller/registry.h"
#include "numerics/decompositions.h"

namespace tachless::lyapunov {
namespace {

using base::parallel_map;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double widest_error = 6;  // [rad; m] of the sets that are looked at
// Directions in which growth is looked for. More of them find the region smaller, or equal: a
// candidate is compared by few, and the result takes as many as some seconds allow.
constexpr int directions_of_candidate = 150, directions_of_result = 4000;
// Ascents from the worst of the directions. A step shrinks to a 24th of its size in 30 failures.
constexpr int ascents = 16, ascent_steps = 30;
constexpr double scale_ratio = 1.4;  // of the scales that are tried: half an octave

/// The one-tick map on the observable part of the state, in scaled coordinates y: x = lift y, y =
/// project x. Each coordinate is about 1 at its largest after an error of one joint.
struct Reduced {
  const OneTick& F;
  VectorXd scale;
  MatrixXd basis;
  MatrixXd lift = scale.asDiagonal() * basis;
  MatrixXd project = basis.transpose() * scale.cwiseInverse().asDiagonal();

  [[nodiscard]] MatrixXd of(const MatrixXd& A) const { return project * A * lift; }
};

VectorXd direction(Index size, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  return VectorXd::NullaryExpr(size, [&] { return normal(random); }).normalized();
}

std::vector<VectorXd> directions(Index size, std::size_t count) {
  return parallel_map(count, [&](std::size_t i) { return direction(size, i); });
}

/// The set y' P y <= s² by directions z of the unit sphere: y = s L^-T z, P = L L'.
class Ellipsoid {
 public:
  Ellipsoid(const Reduced& map, const MatrixXd& P) : map_(map), P_(P), factor_(P) {}

  [[nodiscard]] bool valid() const { return P_.allFinite() && factor_.info() == Eigen::Success; }
  [[nodiscard]] const MatrixXd& P() const { return P_; }
  /// V(F(x)) / V(x) there; infinite where F is no number.
  [[nodiscard]] double growth(const VectorXd& z, double s) const {
    const VectorXd next = map_.project * map_.F(s * (map_.lift * factor_.matrixU().solve(z)));
    const double V = next.dot(P_ * next) / (s * s * z.squaredNorm());
    return std::isfinite(V) ? V : infinity;
  }
  /// Directions of runs' starts, whose torques are the largest.
  [[nodiscard]] std::vector<VectorXd> starts(std::size_t count) const {
    const Index n = map_.F.plant_size();
    std::vector<VectorXd> all = directions(n, count);
    for (VectorXd& z : all) {
      const VectorXd x = map_.F.start(map_.scale.head(n).cwiseProduct(z));
      z = (factor_.matrixU() * (map_.project * x)).normalized();
    }
    return all;
  }
  /// Largest error of a joint where s = 1.
  [[nodiscard]] double widest() const {
    const MatrixXd C = map_.lift * factor_.solve(map_.lift.transpose());
    return std::sqrt(C.diagonal().head(map_.F.num_joints()).maxCoeff());
  }
  [[nodiscard]] Index size() const { return P_.rows(); }

 private:
  const Reduced& map_;
  MatrixXd P_;
  Eigen::LLT<MatrixXd> factor_;
};

/// Returns the least of some radii up to `s` at which V does not fall along z; s where V falls at
/// all of them.
double first_growth(const Ellipsoid& set, const VectorXd& z, double s) {
  // Growth begins near the border most often: there the shares are closer.
  constexpr double shares[] = {0.25, 0.5, 0.75, 0.9, 1};
  constexpr int halvings = 6;  // to a 64th of the step between two shares
  const auto falls = [&](double radius) { return set.growth(z, radius) < 1; };
  double low = 0;
  for (const double share : shares) {
    const double high = s * share;
    if (!falls(high)) return linear::edge(low, high, halvings, falls);
    low = high;
  }
  return s;
}

/// From z on, on the sphere of radius s: a direction with more growth, by random steps.
VectorXd ascended(const Ellipsoid& set, VectorXd z, double s, std::uint64_t seed) {
  double best = set.growth(z, s), step = 0.5;
  for (int k = 0; k < ascent_steps && best < 1; ++k) {
    const VectorXd other = (z + step * direction(z.size(), seed + k)).normalized();
    const double growth = set.growth(other, s);
    if (growth > best) {
      best = growth;
      z = other;
    } else {
      step *= 0.9;
    }
  }
  return z;
}

/// Returns the largest radius up to `s` at which no growth is found along these directions, nor by
/// ascents from the worst of them. Returns 0 where ascents find growth again and again.
double searched_radius(const Ellipsoid& set, double s, const std::vector<VectorXd>& along) {
  const auto least = [&](const auto& radius, std::size_t number) {
    constexpr std::size_t batch = 64;
    for (std::size_t begin = 0; begin < number; begin += batch) {
      for (const double each : parallel_map(std::min(batch, number - begin),
                                            [&](std::size_t i) { return radius(begin + i); })) {
        s = std::min(s, each);
      }
    }
  };
  least([&](std::size_t i) { return first_growth(set, along[i], s); }, along.size());
  auto worst = parallel_map(along.size(),
                            [&](std::size_t i) { return std::pair(-set.growth(along[i], s), i); });
  std::ranges::sort(worst);
  const std::size_t begins = std::min<std::size_t>(ascents, worst.size());
  constexpr int most_rounds = 100;  // each lowers s; a set that needs more is no region
  for (int round = 0;; ++round) {
    if (round == most_rounds) return 0;
    const double before = s;
    least(
        [&](std::size_t i) {
          const std::size_t seed = worst[i].second;
          return first_growth(set, ascended(set, along[seed], s, 1000 * (seed + 1)), s);
        },
        begins);
    if (!(s < before)) return s;
  }
}

/// Returns the scale of each state: its largest value after a unit error of its joint, in the
/// linear loop. States are ordered by joint.
VectorXd scales(const OneTick& F, const MatrixXd& A, double radius) {
  VectorXd largest = VectorXd::Zero(A.rows());
  const Index n = F.num_joints();
  const int ticks = static_cast<int>(std::min(4000.0, 4 / (1 - radius)));
  for (Index i = 0; i < n; ++i) {
    VectorXd x = F.start(VectorXd::Unit(F.plant_size(), i));
    for (int k = 0; k < ticks; ++k) {
      for (Index j = i; j < x.size(); j += n) largest[j] = std::max(largest[j], std::abs(x[j]));
      x = A * x;
    }
  }
  return largest.cwiseMax(1e-9);
}

/// Returns the map on the observable part of the state. The plant's motion and the torques under
/// way show that part over as many ticks as the state has numbers. A filter's memory (nu, e) shows
/// one combination.
Reduced reduced(const OneTick& F, const MatrixXd& A, const VectorXd& scale) {
  const MatrixXd map = scale.cwiseInverse().asDiagonal() * A * scale.asDiagonal();
  MatrixXd seen = MatrixXd::Zero(A.rows(), A.rows()),
           power = MatrixXd::Identity(A.rows(), A.rows());
  for (Index k = 0; k < A.rows(); ++k, power = map * power) {
    const Index p = F.plant_size(), under_way = F.delay() * F.num_joints();
    seen += power.topRows(p).transpose() * power.topRows(p) +
            power.bottomRows(under_way).transpose() * power.bottomRows(under_way);
  }
  const numerics::SymmetricEigen modes = numerics::symmetric_eigen(seen);
  const Index size = (modes.values.array() > 1e-10 * modes.values.maxCoeff()).count();
  return {F, scale, modes.vectors.rightCols(size)};
}

/// Returns P = Q + sum_k w_k A_k' P A_k / r², in which the first map counts as much as all others.
/// The sum ends after some hundred terms: any P may be tried.
MatrixXd mean_lyapunov(const std::vector<MatrixXd>& maps, double r, const MatrixXd& Q) {
  constexpr int most_terms = 600;
  const double others = 0.5 / static_cast<double>(maps.size() - 1);
  MatrixXd P = Q;
  for (int k = 0; k < most_terms; ++k) {
    MatrixXd next = Q;
    for (std::size_t i = 0; i < maps.size(); ++i) {
      next.noalias() += ((i == 0 ? 0.5 : others) / (r * r)) * (maps[i].transpose() * P * maps[i]);
    }
    const double change = (next - P).norm();
    P = (next + next.transpose()) / 2;
    if (!P.allFinite() || change < 1e-6 * P.norm()) break;
  }
  return P;
}

/// The map at q_ref, then at postures whose joints are all `spread` away from it.
std::vector<MatrixXd> maps_about(const scenario::Scenario& scenario, const OneTick& F,
                                 double spread) {
  std::vector<MatrixXd> maps = {F.linear()};
  for (int pattern = 0; pattern < 4; ++pattern) {
    Vector q = F.q_ref();
    for (Index j = 0; j < q.size(); ++j) {
      const bool minus = (pattern % 2 == 1) != (pattern >= 2 && j % 2 == 1);
      q[j] += minus ? -spread : spread;
    }
    maps.push_back(OneTick(scenario, q).linear());
  }
  return maps;
}

SampledRegion region_of(const Reduced& map, const MatrixXd& P) {
  const Index n = map.F.num_joints();
  SampledRegion result{map.F.q_ref(),
                       map.project.transpose() * P * map.project,
                       VectorXd(n),
                       VectorXd(n),
                       0,
                       false,
                       0};
  for (Index i = 0; i < n; ++i) {
    const VectorXd unit = VectorXd::Unit(map.F.plant_size(), i);
    result.e_at_rest[i] = 1 / std::sqrt(result.V(map.F.start(unit)));
    result.edot[i] = 1 / std::sqrt(result.P(n + i, n + i));
  }
  return result;
}

/// A candidate for P. Its parameters are the postures' distance from q_ref [rad; m] and factors of
/// scales: one for each joint, and one for rates and memory.
struct Candidate {
  double spread = 0;
  VectorXd joint;
  double rates = 1;

  double value = -infinity;  ///< of its e_at_rest: sum of the logarithms plus the least of them
  MatrixXd P;                ///< in y
};

void evaluate(Candidate& candidate, const scenario::Scenario& scenario, const Reduced& map,
              double radius) {
  std::vector<MatrixXd> maps = maps_about(scenario, map.F, candidate.spread);
  for (MatrixXd& each : maps) each = map.of(each);
  const Index n = map.F.num_joints(), size = map.scale.size();
  VectorXd weight(size);
  for (Index i = 0; i < size; ++i) {
    const bool rate = i >= n && i < size - n * map.F.delay();
    weight[i] = std::pow(candidate.joint[i % n] * (rate ? candidate.rates : 1), -2);
  }
  const MatrixXd Q = map.basis.transpose() * weight.asDiagonal() * map.basis;
  const Ellipsoid set(map, mean_lyapunov(maps, 1 - 0.25 * (1 - radius), Q));
  if (!set.valid() ||
      numerics::smallest_eigenvalue(set.P() - maps[0].transpose() * set.P() * maps[0]) <= 0) {
    return;
  }
  const double s = searched_radius(set, widest_error / set.widest(),
                                   directions(set.size(), directions_of_candidate));
  if (!(s > 0)) return;
  candidate.P = set.P() / (s * s);
  const Eigen::ArrayXd e = region_of(map, candidate.P).e_at_rest.array().log();
  candidate.value = e.sum() + e.minCoeff();
}

/// Returns the better candidate of two spreads, or the first smaller spread that works, after
/// changes that help.
Candidate best_candidate(const scenario::Scenario& scenario, const Reduced& map, double radius) {
  const Index n = map.F.num_joints();
  Candidate best;
  const auto try_out = [&](Candidate other) {
    other.value = -infinity;
    evaluate(other, scenario, map, radius);
    if (!(other.value > best.value)) return false;
    best = std::move(other);
    return true;
  };
  for (const double spread : {0.5, 1.0, 0.25, 0.125, 0.0625, 0.03125, 0.015625}) {
    if (spread >= 0.5 || best.P.size() == 0) try_out({spread, VectorXd::Ones(n), 1, 0, {}});
  }
  if (best.P.size() == 0) return best;
  const int rounds = n <= 2 ? 3 : 1;
  for (int i = 0; i < rounds * (n + 2); ++i) {
    const Index j = i % (n + 2);
    for (const double factor : {scale_ratio, 1 / scale_ratio}) {
      Candidate other = best;
      (j < n ? other.joint[j] : j == n ? other.rates : other.spread) *= factor;
      if (try_out(other)) break;
    }
  }
  return best;
}

}  // namespace

std::optional<SampledRegion> sampled_region(const scenario::Scenario& scenario,
                                            std::string& why_not, const linear::OnProgress& tell) {
  why_not = controller::law_facts(scenario.controller.law).no_linearisation;
  const auto& flexible = scenario.robot.flexible;
  if (why_not.empty() && (scenario.plant.drive.dry_friction() ||
                          (flexible && !flexible->motor_coulomb_friction_Nm.isZero(0)))) {
    why_not = "dry friction holds joints beside the reference";
  }
  if (why_not.empty() && scenario.gives("plant.drive.loop")) {
    why_not = "the map of one tick has no loop inside the drives (plant.drive.loop)";
  }
  if (!why_not.empty()) return {};
  tell("sampled loop, nonlinear");
  const OneTick F(scenario, linear::ScenarioLoop(scenario).rest_at(0).q_ref);
  const MatrixXd A = F.linear();
  const double radius = linear::spectral_radius(A);
  why_not = "the loop is unstable at rest there";
  if (!(radius < 1)) return {};
  const Reduced map = reduced(F, A, scales(F, A, radius));

  const Candidate best = best_candidate(scenario, map, radius);
  why_not = "no set was found";
  if (best.P.size() == 0) return {};
  tell("sampled loop, nonlinear: more directions");
  const Ellipsoid set(map, best.P);
  const std::size_t any = F.num_joints() <= 2 ? directions_of_result : directions_of_result / 4;
  constexpr std::size_t starts = directions_of_result / 4;
  const double s = searched_radius(set, searched_radius(set, 1.0, directions(set.size(), any)),
                                   set.starts(starts));
  if (!(s > 0)) return {};
  SampledRegion result = region_of(map, best.P / (s * s));
  result.directions = static_cast<int>(any + starts);
  result.widest = s * set.widest();
  result.cut = result.widest > 0.999 * widest_error;
  why_not.clear();
  return result;
}

}  // namespace tachless::lyapunov
