#include "identify/excite.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <random>
#include <utility>

#include "base/failure.h"
#include "identify/least_squares.h"
#include "numerics/decompositions.h"
#include "plant/motion_guard.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"
#include "robot/kinematics.h"

namespace tachless::identify {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Motions drawn for all joints; then the best one with one joint at a time drawn anew, since a
// motion that shows one joint well is kept for it.
constexpr int draws = 20, redraws = 60;
constexpr int harmonics = 6;  // sines of a joint; two may have the same frequency
// Frequencies are multiples of the base. The highest is a fifteenth of the cutoff of the
// regression's low-pass (least_squares.cpp).
constexpr double base_hz = 0.1, highest_hz = 1;
constexpr double most_fall = 2;    ///< largest exponent with which amplitudes fall with frequency
constexpr double row_s = 0.2;      ///< between waypoints, a fifth of the fastest period
constexpr double ramp_s = 2;       ///< of the envelope at each end
constexpr double sample_s = 0.01;  ///< step at which regression and limits are evaluated
// Shares of the joints' ranges, and of speed and torque limits, that a motion takes. The rest is
// for following errors and for friction that is not known yet. Speed where the URDF has no limit
// [rad/s].
constexpr double of_range = 0.9, of_limit = 0.8, usual_speed = 1;

/// Returns the largest deflection from the start that each joint has on both sides.
VectorXd room(const scenario::Scenario& scenario, double reach) {
  const Vector& start = scenario.plant.initial.position_rad;
  const robot::Model& model = *scenario.model;
  VectorXd result = VectorXd::Constant(scenario.num_joints, reach);
  for (int i = 0; i < scenario.num_joints; ++i) {
    if (!std::isfinite(model.lower[i]) && !std::isfinite(model.upper[i])) continue;
    const auto [lower, upper] = robot::finite_range(model, i);
    const double middle = (lower + upper) / 2, half = of_range * (upper - lower) / 2;
    const double side = half - std::abs(start[i] - middle);
    if (side < std::min(0.02, half / 2)) {  // a gripper finger's whole range is shorter
      throw scenario.complaint(
          "plant.initial.position_rad",
          "joint {} begins {:.2g} from the end of its range; begin further inside",
          model.joint_names[static_cast<std::size_t>(i)], side);
    }
    result[i] = std::min(reach, side);
  }
  return result;
}

/// Draws offsets from the start, one row per waypoint. Each row begins and ends with zero.
MatrixXd draw(std::mt19937& random, const VectorXd& start, const VectorXd& most,
              Eigen::Index rows) {
  std::uniform_real_distribution<double> part(0, 1);
  MatrixXd result = MatrixXd::Zero(rows, start.size());
  const double end = static_cast<double>(rows - 1) * row_s;
  for (Eigen::Index j = 0; j < start.size(); ++j) {
    // Low frequencies excite gravity and friction, high frequencies inertia.
    const double fall = most_fall * part(random);
    for (int h = 0; h < harmonics; ++h) {
      const double hz = base_hz * std::round(std::pow(highest_hz / base_hz, part(random)));
      const double phase = 2 * std::numbers::pi * part(random),
                   amplitude = part(random) / std::pow(hz, fall);
      for (Eigen::Index k = 0; k < rows; ++k) {
        const double t = static_cast<double>(k) * row_s;
        result(k, j) += amplitude * std::sin(2 * std::numbers::pi * hz * t + phase);
      }
    }
    for (Eigen::Index k = 0; k < rows; ++k) {
      const double t = static_cast<double>(k) * row_s;
      const double x = std::clamp(std::min(t, end - t) / ramp_s, 0.0, 1.0);
      result(k, j) *= x * x * (3 - 2 * x);
    }
    result.col(j) *= most[j] / std::max(1e-12, result.col(j).cwiseAbs().maxCoeff());
  }
  return result;
}

/// Returns the motion's waypoints, a row of offsets from the start per waypoint.
reference::trajectory::Waypoints waypoints(const MatrixXd& offset, const VectorXd& start) {
  reference::trajectory::Waypoints result;
  for (Eigen::Index k = 0; k < offset.rows(); ++k) {
    result.time_s.push_back(static_cast<double>(k) * row_s);
    result.position_rad.emplace_back(start + offset.row(k).transpose());
  }
  return result;
}

/// Returns the duration of a run of the motion, a whole number of periods that ends after it [s].
double duration(const MatrixXd& offset, double period_s) {
  const double end = static_cast<double>(offset.rows() - 1) * row_s;
  return std::ceil((end + 0.5) / period_s) * period_s;
}

/// Returns the motion as overrides of the scenario.
std::vector<std::string> overrides_of(const MatrixXd& offset, const VectorXd& start,
                                      double period_s) {
  const reference::trajectory::Waypoints points = waypoints(offset, start);
  std::string rows;
  for (const Vector& q : points.position_rad) {
    rows += fmt::format("{}[{:.5g}]", rows.empty() ? "" : ", ", fmt::join(q, ", "));
  }
  return {fmt::format("reference={{waypoints: {{time_s: [{:.6g}], position_rad: [{}]}}}}",
                      fmt::join(points.time_s, ", "), rows),
          fmt::format("loop.duration_s={:.12g}", duration(offset, period_s))};
}

struct Motion {
  Recording recording;     ///< torques of the arm without unknowns
  VectorXd speed, torque;  ///< largest of each joint
  /// Largest share of a speed limit that decreases toward the ends of the range; zero without one.
  VectorXd share;
  VectorXd holding;  ///< torque at rest at the start
};

Motion motion_of(const scenario::Scenario& scenario) {
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  const auto rows = static_cast<Eigen::Index>(scenario.loop.duration_s / sample_s);
  const Eigen::Index n = scenario.num_joints;
  Motion motion{{"the motion", scenario, MatrixXd(rows, n), MatrixXd::Zero(rows, n)},
                VectorXd::Zero(n),
                VectorXd::Zero(n),
                VectorXd::Zero(n),
                {}};
  motion.recording.scenario.loop.period_s = sample_s;
  robot::Model model = scenario::with_payload(scenario, *scenario.model);
  model.rotor_inertia = scenario.robot.rigid_rotor_inertia_kgm2;
  const plant::MotionGuard guard(model, scenario.robot.urdf_path);
  const plant::DriveSpec& drive = scenario.plant.drive;
  for (Eigen::Index k = 0; k < rows; ++k) {
    const messages::ReferencePoint at = trajectory.at(static_cast<double>(k) * sample_s);
    motion.recording.q.row(k) = at.q_ref.transpose();
    motion.speed = motion.speed.cwiseMax(at.v_ref.cwiseAbs());
    for (Eigen::Index i = 0; i < n; ++i) {
      if (!guard.slows_near_ends(i) || at.v_ref[i] == 0) continue;
      const double limit = guard.speed_limit(i, at.q_ref[i], at.v_ref[i]);
      motion.share[i] = std::max(motion.share[i], std::abs(at.v_ref[i]) / limit);
    }
    const Vector tau =
        robot::inverse_dynamics<double>(model, at.q_ref, at.v_ref, at.a_ref).cwiseAbs() +
        drive.viscous_friction_Nms_per_rad.cwiseProduct(at.v_ref.cwiseAbs()) +
        drive.coulomb_friction_Nm;
    if (k == 0) motion.holding = tau;
    motion.torque = motion.torque.cwiseMax(tau);
  }
  return motion;
}

/// Returns the factors by which the joints' motions have to shrink to keep speeds and torques; 1:
/// none.
VectorXd shrink(const scenario::Scenario& scenario, const Motion& motion) {
  VectorXd factor = VectorXd::Ones(motion.speed.size());
  const Vector& rated = scenario.model->velocity_limit;
  for (Eigen::Index i = 0; i < factor.size(); ++i) {
    const double speed = std::isfinite(rated[i]) ? of_limit * rated[i] : usual_speed;
    factor[i] = std::min({1.0, speed / std::max(1e-12, motion.speed[i]),
                          of_limit / std::max(1e-12, motion.share[i])});
  }
  if (!scenario.plant.drive.torque_limit_Nm) return factor;
  const VectorXd left = of_limit * *scenario.plant.drive.torque_limit_Nm - motion.holding;
  // A joint's torque depends on the motions of all joints, so one factor serves all.
  const VectorXd moving = (motion.torque - motion.holding).cwiseMax(1e-12);
  return factor * std::clamp(left.cwiseQuotient(moving).minCoeff(), 0.0, 1.0);
}

/// Returns the size beyond which nobody seeks a parameter [its unit]. Sizes make information on
/// parameters of different units comparable, and finite where a motion does not show one.
double size_of(const Parameters::Entry& entry) {
  constexpr double length = 0.1;  // [m]
  if (entry.kind != Kind::inertia || entry.component == 0) return 10;
  return 10 * length * (entry.component < 4 ? 1 : length);
}

/// Information of a motion on the unknowns.
class Information {
 public:
  /// @param noise standard deviation of each joint's torque [N m; N]
  Information(const Regression& of, const Parameters& parameters, const VectorXd& noise) {
    VectorXd size(parameters.size());
    for (Eigen::Index i = 0; i < size.size(); ++i) {
      size[i] = size_of(parameters.entries()[static_cast<std::size_t>(i)]);
    }
    const std::vector<RowUse> fast(static_cast<std::size_t>(noise.size()), RowUse::fast);
    MatrixXd rows = of.columns;
    for (Eigen::Index row = 0; row < rows.rows(); ++row) {
      rows.row(row) *= of.used(row, fast) ? 1 / noise[of.joint[row]] : 0;
    }
    normal_ = rows.transpose() * rows / rows_alike(of);
    MatrixXd sized = size.asDiagonal() * normal_ * size.asDiagonal();
    sized.diagonal().array() += 1;
    log_determinant_ = numerics::symmetric_eigenvalues(sized).array().log().sum();
  }

  [[nodiscard]] double log_determinant() const { return log_determinant_; }

  /// Sets the condition and the predicted widths.
  void predict(const Parameters& parameters, Excitation& to) const {
    constexpr double zero = 1e-9;  // share of the largest eigenvalue, as in `precision`
    VectorXd norm = normal_.diagonal().cwiseSqrt();
    norm = norm.cwiseMax(1e-10 * norm.maxCoeff());
    const VectorXd unit = norm.cwiseInverse();
    const auto [all, V] =
        numerics::symmetric_eigen(unit.asDiagonal() * normal_ * unit.asDiagonal());
    const Eigen::Index null = (all.array() < zero * all.maxCoeff()).count();
    const VectorXd value = all.tail(all.size() - null);
    const MatrixXd vectors = V.rightCols(value.size());
    to.condition = std::sqrt(value.maxCoeff() / value.minCoeff());
    for (Eigen::Index i = 0; i < norm.size(); ++i) {
      const auto& entry = parameters.entries()[static_cast<std::size_t>(i)];
      if (entry.kind == Kind::inertia) continue;
      const bool alone = V.row(i).head(null).squaredNorm() < 1e-6;
      const double deviation =
          unit[i] * std::sqrt(vectors.row(i).cwiseAbs2().dot(value.cwiseInverse()));
      to.widths.push_back({entry.name, entry.unit,
                           alone ? 1.96 * deviation : std::numeric_limits<double>::infinity()});
    }
  }

 private:
  MatrixXd normal_;
  double log_determinant_ = 0;
};

/// Designs motions of one scenario.
class Designer {
 public:
  Designer(const scenario::Scenario& scenario, const Parameters& parameters,
           const ExcitationGoal& goal)
      : scenario_(scenario),
        parameters_(parameters),
        goal_(goal),
        most_(room(scenario, goal.reach)),
        rows_(static_cast<Eigen::Index>(std::round(goal.duration_s / row_s)) + 1) {}

  /// Returns a motion that is drawn at random: an offset from the start per waypoint.
  [[nodiscard]] MatrixXd drawn(std::mt19937& random) const {
    return draw(random, scenario_.plant.initial.position_rad, most_, rows_);
  }

  /// Takes a motion if it has more information than the best one so far.
  void consider(MatrixXd offset) {
    const VectorXd& start = scenario_.plant.initial.position_rad;
    Motion motion = motion_of(moving(offset));
    constexpr int most_passes = 8;  // a motion that is still too fast is dropped
    for (int pass = 0; pass < most_passes; ++pass) {
      const VectorXd factor = shrink(scenario_, motion);
      if (factor.minCoeff() >= 1) break;
      offset = offset * (0.99 * factor).cwiseMin(1).asDiagonal();
      motion = motion_of(moving(offset));
    }
    if ((shrink(scenario_, motion).array() < 1).any()) return;
    if (goal_.floor && lowest(motion) < *goal_.floor) {
      below_floor_ = true;
      return;
    }
    if (noise_.size() == 0) noise_ = noise_of(motion);
    motion.recording.tau.rowwise() = motion.torque.transpose();
    const Information found(regression(motion.recording, parameters_), parameters_, noise_);
    if (best_ && found.log_determinant() <= most_found_) return;
    most_found_ = found.log_determinant();
    offset_ = offset;
    best_ = Excitation{
        overrides_of(offset, start, scenario_.loop.period_s), {},           0,
        offset.cwiseAbs().colwise().maxCoeff().transpose(),   motion.speed, motion.torque};
    found.predict(parameters_, *best_);
  }

  [[nodiscard]] const std::optional<Excitation>& best() const { return best_; }
  [[nodiscard]] const MatrixXd& offset() const { return offset_; }
  [[nodiscard]] bool below_floor() const { return below_floor_; }

 private:
  /// Returns the scenario with this motion as its reference.
  [[nodiscard]] scenario::Scenario moving(const MatrixXd& offset) const {
    scenario::Scenario result = scenario_;
    result.reference = waypoints(offset, scenario_.plant.initial.position_rad);
    result.loop.duration_s = duration(offset, scenario_.loop.period_s);
    return result;
  }

  [[nodiscard]] VectorXd noise_of(const Motion& motion) const {
    const std::optional<Vector>& limit = scenario_.plant.drive.torque_limit_Nm;
    const VectorXd largest = limit ? VectorXd(*limit) : motion.torque;
    return (noise_share * largest).cwiseMax(1e-9);
  }

  /// Returns the least height of a link's origin above the root link's.
  [[nodiscard]] double lowest(const Motion& motion) const {
    double least = std::numeric_limits<double>::infinity();
    const robot::Model& model = *scenario_.model;
    const Eigen::Vector3d up = -model.gravity.normalized();
    constexpr Eigen::Index every = 5;  // 50 ms
    for (Eigen::Index k = 0; k < motion.recording.q.rows(); k += every) {
      const Vector q = motion.recording.q.row(k).transpose();
      for (const auto& [name, frame] : model.frames) {
        if (frame.body >= 0) least = std::min(least, up.dot(robot::frame_pose(model, frame, q).p));
      }
    }
    return least;
  }

  const scenario::Scenario& scenario_;
  const Parameters& parameters_;
  const ExcitationGoal& goal_;
  VectorXd most_, noise_;
  Eigen::Index rows_;
  MatrixXd offset_;
  std::optional<Excitation> best_;
  double most_found_ = 0;
  bool below_floor_ = false;
};

}  // namespace

Excitation excite(const scenario::Scenario& scenario, const std::vector<Kind>& unknown,
                  const ExcitationGoal& goal, const Report& report) {
  if (scenario.robot.flexible) throw scenario.complaint("robot.joints", "flexible; needed: rigid");
  const Parameters parameters(scenario, unknown);
  Designer designer(scenario, parameters, goal);
  std::mt19937 random(1);
  for (int i = 0; i < draws + redraws; ++i) {
    if (i % 10 == 0) report(fmt::format("motion {} of {}", i + 1, draws + redraws));
    MatrixXd offset = designer.drawn(random);
    if (i >= draws && designer.best()) {
      const Eigen::Index joint = i % scenario.num_joints;
      const VectorXd anew = offset.col(joint);
      offset = designer.offset();
      offset.col(joint) = anew;
    }
    designer.consider(std::move(offset));
  }
  if (designer.best()) return *designer.best();
  if (designer.below_floor()) {
    throw scenario.complaint("plant.initial.position_rad",
                             "no motion keeps the links' origins above {:g} m; begin higher, or "
                             "give a smaller --reach",
                             *goal.floor);
  }
  throw scenario.complaint(
      "plant.drive.torque_limit_Nm",
      "holding the arm at its start takes four fifths of it or more; begin nearer to upright or "
      "hanging");
}

}  // namespace tachless::identify
