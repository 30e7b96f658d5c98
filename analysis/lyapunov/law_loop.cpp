#include "lyapunov/law_loop.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <numbers>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "controller/laws.h"
#include "controller/registry.h"
#include "numerics/decompositions.h"
#include "numerics/golden_section.h"
#include "plant/plant_model.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"
#include "robot/gravity_bound.h"
#include "scenario/largest_friction.h"

namespace tachless::lyapunov {
namespace {

using controller::law::LoriaOrtegaFlexible;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Instants of the reference, evenly over it, at which gains that follow it are examined. Further
/// ones are where the velocity or the gains' rate has a maximum. Each takes a search over postures,
/// so the number bounds the time.
constexpr int instants_of_scheduled = 25;

VectorXd joined(std::initializer_list<Vector> parts) {
  std::vector<double> all;
  for (const Vector& part : parts) all.insert(all.end(), part.begin(), part.end());
  return Eigen::Map<const VectorXd>(all.data(), static_cast<Eigen::Index>(all.size()));
}

/// True for a law whose error system `rigid_loop` can make.
template <class L>
inline constexpr bool has_rigid_loop = requires(const L& law) {
  law.filter_pole();
}
&&!requires { L::no_certificate; };

LawLoop flexible_loop(const scenario::Scenario& scenario) {
  const messages::ReferencePoint reference = reference::make_trajectory(scenario).at(0);
  const auto law = controller::make_law<LoriaOrtegaFlexible>(scenario);
  const auto g = controller::gains_of<LoriaOrtegaFlexible::Gains>(
      scenario, controller::law_facts(LoriaOrtegaFlexible::name));
  const auto& drive = *scenario.robot.flexible;
  const plant::ArmState start =
      plant::initial_state(scenario.plant, scenario.robot.flexible, *scenario.model);
  const messages::LinkStateMeasurement measured{start.q, start.v, start.theta};
  const auto signals = law.step(law.start(measured, reference), measured, reference).signals;
  const auto motor = law.motor_reference(measured, reference, signals.value[1]);
  return {{flexible_error_system(drive.stiffness, drive.rotor_inertia, {g.kp1, g.kd1, g.a1, g.b1},
                                 {g.kp2, g.kd2, g.a2, g.b2})},
          joined({signals.value[0], signals.value[2], signals.value[1], signals.value[3],
                  start.v - reference.v_ref,
                  start.thetadot - robot::first_derivative(motor.theta_ref)}),
          {},
          {},
          {},
          {}};
}

/// Returns times at which f has its `most` largest local maxima: of samples at `t`, refined between
/// their neighbours. A maximum of 0 is left out.
template <class F>
std::vector<double> maxima(const std::vector<double>& t, const F& f, std::size_t most) {
  std::vector<double> value(t.size());
  std::ranges::transform(t, value.begin(), f);
  std::vector<std::size_t> all;
  for (std::size_t k = 0; k < t.size(); ++k) {
    const bool up = k == 0 || value[k] > value[k - 1];
    const bool down = k + 1 == t.size() || value[k] >= value[k + 1];
    if (value[k] > 0 && up && down) all.push_back(k);
  }
  std::ranges::sort(all, std::greater(), [&](std::size_t k) { return value[k]; });
  all.resize(std::min(most, all.size()));
  std::vector<double> result;
  for (const std::size_t k : all) {
    result.push_back(
        numerics::largest_between(f, t[k == 0 ? 0 : k - 1], t[std::min(k + 1, t.size() - 1)]));
  }
  return result;
}

/// Bursts of a motion that are examined, the fastest first. A motion between two points has one.
constexpr std::size_t most_bursts = 3;

/// Returns instants evenly over the burst at `peak_s`, in which |v_ref| is at least half of that at
/// the peak. @param dense increasing times of the motion
std::vector<double> instants_of_burst(const std::vector<double>& dense,
                                      const reference::Trajectory& trajectory, double peak_s) {
  constexpr int count = 9;  // the peak, and four on each side
  const double least = trajectory.at(peak_s).v_ref.norm() / 2;
  const auto fast = [&](double t_s) { return trajectory.at(t_s).v_ref.norm() >= least; };
  const auto peak = std::ranges::lower_bound(dense, peak_s);
  auto begin = peak, end = peak;
  while (begin != dense.begin() && fast(*std::prev(begin))) --begin;
  while (end != dense.end() && fast(*end)) ++end;
  if (begin == end) return {};
  const double first_s = *begin, last_s = *std::prev(end);
  std::vector<double> result;
  for (int k = 0; k < count; ++k) {
    result.push_back(first_s + (last_s - first_s) * k / (count - 1));
  }
  return result;
}

/// Returns instants at which |v_ref| or a joint's |v_ref| is largest, and those of the fastest
/// burst.
std::vector<double> fastest_instants(const reference::Motion& motion,
                                     const reference::Trajectory& trajectory) {
  const std::vector<double> dense = motion.closely();
  std::vector<double> result = maxima(
      dense, [&](double t_s) { return trajectory.at(t_s).v_ref.norm(); }, most_bursts);
  if (!result.empty()) {
    const std::vector<double> burst = instants_of_burst(dense, trajectory, result[0]);
    result.insert(result.end(), burst.begin(), burst.end());
  }
  for (Eigen::Index i = 0; i < trajectory.at(0).v_ref.size(); ++i) {
    for (const double t_s : maxima(
             dense, [&](double t) { return std::abs(trajectory.at(t).v_ref[i]); }, 1)) {
      result.push_back(t_s);
    }
  }
  return result;
}

/// Returns instants at which Kp grows or falls the fastest, relative to Kp: near the fastest
/// instant of each of some stretches of the motion. @param at the error system at a time
template <class At>
std::vector<double> instants_of_gain_rates(const reference::Motion& motion,
                                           const reference::Trajectory& trajectory, const At& at) {
  constexpr std::size_t stretches = 512;  // Kp_dot takes far longer to compute than v_ref
  const std::vector<double> dense = motion.closely();
  std::vector<double> fast;
  for (std::size_t k = 0; k < stretches; ++k) {
    const auto begin = dense.begin() + static_cast<std::ptrdiff_t>(k * dense.size() / stretches);
    const auto end =
        dense.begin() + static_cast<std::ptrdiff_t>((k + 1) * dense.size() / stretches);
    if (begin == end) continue;
    fast.push_back(*std::ranges::max_element(
        begin, end, {}, [&](double t_s) { return trajectory.at(t_s).v_ref.norm(); }));
  }
  std::vector<double> result;
  for (const double sign : {1.0, -1.0}) {
    const auto rate = [&](double t_s) {
      const ErrorSystem s = at(t_s);
      return numerics::eigenvalues(MatrixXd(sign * numerics::inverse(s.kp) * s.kp_dot))
          .real()
          .maxCoeff();
    };
    for (const double t_s : maxima(fast, rate, most_bursts)) result.push_back(t_s);
  }
  return result;
}

template <class L>
LawLoop rigid_loop(const scenario::Scenario& scenario) {
  const L law = controller::make_law<L>(scenario);
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  const messages::ReferencePoint reference = trajectory.at(0);
  const messages::PositionMeasurement measured{scenario.plant.initial.position_rad};
  const auto signals = law.step(law.start(measured, reference), measured, reference).signals;
  LawLoop result;
  result.initial = joined({signals.value[0], signals.value[1],
                           scenario.plant.initial.velocity_rad_per_s - reference.v_ref});
  const reference::Motion motion(scenario, trajectory);
  const auto at = [&](double t_s) {
    return system_at(law, trajectory.at(t_s), scenario.plant.drive.viscous_friction_Nms_per_rad);
  };
  const auto add = [&](const std::vector<double>& instants) {
    for (const double t_s : instants) result.systems.push_back(at(t_s));
  };
  add(motion.instants(instants_of_scheduled));
  add(fastest_instants(motion, trajectory));
  const bool constant = std::ranges::all_of(
      result.systems, [&](const ErrorSystem& s) { return s.kp == result.systems[0].kp; });
  if (!constant) add(instants_of_gain_rates(motion, trajectory, at));
  if (constant) {
    result.systems.resize(1);
    result.systems[0].kp_dot = result.systems[0].kd_dot = {};
    result.systems[0].v_ref = {};
  }
  if constexpr (requires { law.linear_feedback(); }) {
    result.linear_feedback = law.linear_feedback();
  }
  if constexpr (requires { law.integral(); }) {
    if (const controller::law::PassiveIntegral* integral = law.integral()) {
      result.weights = integral->weights();
      result.ki = integral->ki;
      result.d_max = integral->d_max;
    }
  }
  return result;
}

}  // namespace

std::optional<LawLoop> law_loop(const scenario::Scenario& scenario) {
  std::optional<LawLoop> result;
  controller::with_law(scenario.controller.law, [&]<class L>(std::type_identity<L> /*law*/) {
    if constexpr (std::is_same_v<L, LoriaOrtegaFlexible>) result = flexible_loop(scenario);
    if constexpr (has_rigid_loop<L>) result = rigid_loop<L>(scenario);
  });
  return result;
}

std::string no_certificate(const scenario::Scenario& scenario) {
  const std::string& law = scenario.controller.law;
  bool certifiable = false;
  std::string reason;
  controller::with_law(law, [&]<class L>(std::type_identity<L> /*law*/) {
    certifiable = std::is_same_v<L, LoriaOrtegaFlexible> || has_rigid_loop<L>;
    if constexpr (requires { L::no_certificate; }) reason = fmt::format(": {}", L::no_certificate);
  });
  if (!certifiable)
    return fmt::format("no stability certificate is available for {}{}", law, reason);
  const auto* const file = std::get_if<reference::trajectory::MotionFile>(&scenario.reference);
  if (file != nullptr && file->motion == nullptr) {
    return fmt::format("the table {} of the reference was not loaded", file->path);
  }
  if (!controller::law_facts(law).needs_flexible_joints && scenario.robot.flexible) {
    return fmt::format(
        "{} assumes rigid joints, but this robot's are flexible: its proof does not hold", law);
  }
  if (scenario.gives("plant.drive.loop")) {
    return "the drives have a loop of their own (plant.drive.loop), which no proof contains";
  }
  return {};
}

robot::Model error_model(const scenario::Scenario& scenario) {
  return scenario.robot.flexible ? controller::flexible_robot(scenario).links
                                 : controller::rigid_model(scenario);
}

double lyapunov_value(const ErrorSystem& system, const Weights& weights, const robot::Model& links,
                      const Vector& q, const VectorXd& x) {
  return x.dot(lyapunov_matrix(system, weights, robot::mass_matrix(links, q)) * x) / 2;
}

namespace {

/// Returns a bound of |p| on [0, 1] from values of the polynomial p of degree n at n + 1 points:
/// its largest coefficient in Bernstein's basis.
class PolynomialBound {
 public:
  explicit PolynomialBound(int degree) : points(degree + 1), of_values_(degree + 1, degree + 1) {
    for (int k = 0; k <= degree; ++k) {
      points[k] = 0.5 - 0.5 * std::cos(std::numbers::pi * (k + 0.5) / (degree + 1));
      double binomial = 1;
      for (int j = 0; j <= degree; ++j) {
        of_values_(k, j) = binomial * std::pow(points[k], j) * std::pow(1 - points[k], degree - j);
        binomial *= static_cast<double>(degree - j) / (j + 1);
      }
    }
    of_values_ = numerics::inverse(of_values_);
  }

  VectorXd points;  ///< at which values are asked for

  /// @param values a column for each of `points`, a row for each polynomial
  [[nodiscard]] VectorXd operator()(const MatrixXd& values) const {
    return (values * of_values_.transpose()).cwiseAbs().rowwise().maxCoeff();
  }

 private:
  MatrixXd of_values_;
};

/// Returns a bound of a derivative of each joint's reference at all times, of a reference made of
/// polynomials. An inner piece is of degree 5, the first and the last of 7, a single one of 9.
/// @param order of the derivative
VectorXd polynomial_bound(const std::vector<double>& time_s,
                          const reference::Trajectory& trajectory, Eigen::Index num_joints,
                          int order, Vector messages::ReferencePoint::*derivative) {
  const std::array bounds = {PolynomialBound(5 - order), PolynomialBound(7 - order),
                             PolynomialBound(9 - order)};
  VectorXd result = VectorXd::Zero(num_joints);
  for (std::size_t k = 1; k < time_s.size(); ++k) {
    const bool first = k == 1, last = k + 1 == time_s.size();
    const PolynomialBound& bound = bounds[first && last ? 2 : first || last ? 1 : 0];
    MatrixXd values(num_joints, bound.points.size());
    for (Eigen::Index i = 0; i < values.cols(); ++i) {
      const double t_s = time_s[k - 1] + bound.points[i] * (time_s[k] - time_s[k - 1]);
      values.col(i) = trajectory.at(t_s).*derivative;
    }
    result = result.cwiseMax(bound(values));
  }
  return result;
}

}  // namespace

MotionBound motion_bound(const scenario::Scenario& scenario) {
  using messages::ReferencePoint;
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  const reference::trajectory::Composition parts = reference::composition_of(scenario.reference);
  const auto bound = [&](int order, Vector ReferencePoint::*derivative) {
    VectorXd sum =
        polynomial_bound(parts.piece_times_s, trajectory, scenario.num_joints, order, derivative);
    for (const auto& sine : parts.sines) {
      const VectorXd w = 2 * std::numbers::pi * sine.frequency_hz;
      sum.array() += sine.amplitude_rad.array().abs() * w.array().pow(order);
    }
    return sum;
  };
  return {bound(1, &ReferencePoint::v_ref), bound(2, &ReferencePoint::a_ref),
          bound(3, &ReferencePoint::jerk_ref), bound(4, &ReferencePoint::snap_ref)};
}

VelocityBound velocity_bound(const scenario::Scenario& scenario) {
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  const std::vector<double> instants = reference::Motion(scenario, trajectory).closely(20001);
  MatrixXd v(scenario.num_joints, static_cast<Eigen::Index>(instants.size()));
  double dt = 0;
  for (std::size_t k = 0; k < instants.size(); ++k) {
    v.col(static_cast<Eigen::Index>(k)) = trajectory.at(instants[k]).v_ref;
    if (k > 0) dt = std::max(dt, instants[k] - instants[k - 1]);
  }
  const MotionBound all = motion_bound(scenario);
  // Between two instants v_ref is off its chord by at most dt^2/8 sup |jerk|, in any norm.
  const auto most = [&](const MatrixXd& norm) {
    const double size = (norm * v).colwise().norm().maxCoeff();
    const VectorXd of_joints = norm.colwise().norm();
    return size == 0 ? 0
                     : std::min(size + dt * dt / 8 * of_joints.dot(all.jerk), of_joints.dot(all.v));
  };
  const MatrixXd one = MatrixXd::Identity(v.rows(), v.rows());
  VelocityBound bound{most(one), VectorXd(v.rows()), {}};
  for (Eigen::Index i = 0; i < v.rows(); ++i) bound.each[i] = most(one.row(i));
  if (bound.speed == 0) return bound;
  const auto [values, vectors] = numerics::symmetric_eigen(v * v.transpose());
  const VectorXd axes = values.cwiseMax(1e-6 * values.maxCoeff()).cwiseSqrt();
  bound.scale = vectors * axes.asDiagonal();
  bound.scale *= most(axes.cwiseInverse().asDiagonal() * vectors.transpose());
  return bound;
}

FrictionTorques friction_torques(const scenario::Scenario& scenario, const VectorXd& v_ref) {
  const auto& drive = scenario.plant.drive;
  const auto& forward = scenario.controller.friction;
  const VectorXd Fc = drive.coulomb_friction_Nm;
  const VectorXd largest = scenario::largest_friction(scenario);
  const VectorXd zero = VectorXd::Zero(Fc.size());
  if (v_ref.isZero(0)) return {zero, largest};  // v = edot, and friction takes energy
  const VectorXd Ff = forward.given() ? VectorXd(forward.coulomb) : zero;
  const VectorXd D = forward.given() ? VectorXd(forward.viscous) : zero;
  const VectorXd missing = VectorXd(drive.viscous_friction_Nms_per_rad) - D;
  FrictionTorques result{missing.cwiseAbs().cwiseProduct(v_ref), zero};
  const auto add = [&](const Vector& term, const auto& size) {
    if (term.size() > 0) result.on_y += size(VectorXd(term));
  };
  add(drive.friction_rise_Nm, [](const VectorXd& rise) { return VectorXd(-rise.cwiseMin(0)); });
  add(forward.rise, [](const VectorXd& rise) { return VectorXd(rise.cwiseAbs()); });
  if (forward.needs_gravity()) {
    result.on_y +=
        forward.load.cwiseProduct(robot::gravity_bound(controller::rigid_model(scenario)));
  }
  if (Ff.isZero(0)) {
    result.on_y += largest;
  } else {
    result.on_y += largest - Fc + (Fc - Ff).cwiseAbs();
    result.on_delta = 2 * Fc;
    result.power = 0.2785 * Fc.dot(VectorXd(forward.smoothing));
  }
  return result;
}

}  // namespace tachless::lyapunov
