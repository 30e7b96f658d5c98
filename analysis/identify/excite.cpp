#include "identify/excite.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <random>
#include <stdexcept>
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

// Motions drawn for all joints; then changes of one joint's series in the best of them. With links
// unknown each takes several times as long.
constexpr int draws = 20, changes = 3000, changes_with_links = 1500;
constexpr int most_draws = 100;  ///< if none of the first is allowed
/// Sines and cosines of a joint, at multiples of the base frequency. The highest is a fifteenth of
/// the cutoff of the regression's low-pass (least_squares.cpp).
constexpr int harmonics = 10;
constexpr double base_hz = 0.1;
constexpr double most_fall = 2;  ///< largest exponent with which amplitudes fall with frequency
// A change of a joint's series is normal, with this size relative to the series at first. It grows
// with a success and decreases with a failure, within these bounds.
constexpr double first_size = 0.3, growth = 1.6, decrease = 0.95, least_size = 0.02, most_size = 1;
constexpr double least_deflection = 0.1;  ///< of the largest deflection that a joint may take
/// Weight of the logarithm of the condition number for each determined parameter, with links
/// unknown: a smaller condition costs a little information on each of many parameters.
constexpr double condition_weight = 6;
constexpr double row_s = 0.2;  ///< between waypoints, a fifth of the fastest period
constexpr double ramp_s = 2;   ///< of the envelope at each end
// Steps at which regression and limits are evaluated: of the motions that are compared, and of the
// one that is chosen.
constexpr double coarse_s = 0.05, fine_s = 0.01;
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

/// Fourier series of the joints.
struct Series {
  MatrixXd coefficient;  ///< sine and cosine of each harmonic in turn, a column of norm 1 per joint
  VectorXd share;        ///< part of the largest deflection that each joint takes
};

/// Draws a joint's coefficients.
VectorXd drawn_coefficients(std::mt19937& random) {
  std::uniform_real_distribution<double> part(0, 1);
  // Low frequencies excite gravity and friction, high frequencies inertia.
  const double fall = most_fall * part(random);
  VectorXd result(2 * harmonics);
  for (int h = 0; h < harmonics; ++h) {
    const double amplitude = part(random) / std::pow(h + 1, fall),
                 phase = 2 * std::numbers::pi * part(random);
    result[2 * h] = amplitude * std::cos(phase);
    result[2 * h + 1] = amplitude * std::sin(phase);
  }
  return result.normalized();
}

/// Changes joint j.
void change(Series& series, Eigen::Index j, double size, std::mt19937& random) {
  std::normal_distribution<double> normal;
  auto column = series.coefficient.col(j);
  for (double& each : column) each += size * normal(random) / std::sqrt(2.0 * harmonics);
  column.normalize();
  constexpr double of_share = 0.3;  // relative to the change of the coefficients
  series.share[j] = std::clamp(series.share[j] * std::exp(of_share * size * normal(random)),
                               least_deflection, 1.0);
}

/// Returns the series with an envelope: offsets from the start, a row per waypoint. Each joint
/// begins and ends with zero.
MatrixXd offsets(const Series& series, const VectorXd& most, Eigen::Index rows) {
  const double end = static_cast<double>(rows - 1) * row_s;
  MatrixXd waves(rows, 2 * harmonics);
  for (Eigen::Index k = 0; k < rows; ++k) {
    const double t = static_cast<double>(k) * row_s;
    const double x = std::clamp(std::min(t, end - t) / ramp_s, 0.0, 1.0);
    for (int h = 0; h < harmonics; ++h) {
      const double angle = 2 * std::numbers::pi * base_hz * (h + 1) * t;
      waves(k, 2 * h) = x * x * (3 - 2 * x) * std::sin(angle);
      waves(k, 2 * h + 1) = x * x * (3 - 2 * x) * std::cos(angle);
    }
  }
  MatrixXd result = waves * series.coefficient;
  for (Eigen::Index j = 0; j < result.cols(); ++j) {
    const double largest = std::max(1e-12, result.col(j).cwiseAbs().maxCoeff());
    result.col(j) *= series.share[j] * most[j] / largest;
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

/// Evaluates a motion at every `sample_s`.
Motion motion_of(const scenario::Scenario& scenario, double sample_s) {
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
  Information(const Regression& regression, const Parameters& parameters, const VectorXd& noise) {
    VectorXd size(parameters.size());
    for (Eigen::Index i = 0; i < size.size(); ++i) {
      size[i] = size_of(parameters.entries()[static_cast<std::size_t>(i)]);
    }
    const std::vector<RowUse> fast(static_cast<std::size_t>(noise.size()), RowUse::fast);
    MatrixXd rows = regression.columns;
    for (Eigen::Index row = 0; row < rows.rows(); ++row) {
      rows.row(row) *= regression.used(row, fast) ? 1 / noise[regression.joint[row]] : 0;
    }
    const MatrixXd normal = rows.transpose() * rows / rows_alike(regression);
    MatrixXd sized = size.asDiagonal() * normal * size.asDiagonal();
    sized.diagonal().array() += 1;
    log_determinant_ = numerics::symmetric_eigenvalues(sized).array().log().sum();

    constexpr double zero = 1e-9;  // share of the largest eigenvalue, as in `precision`
    VectorXd norm = normal.diagonal().cwiseSqrt();
    norm = norm.cwiseMax(1e-10 * norm.maxCoeff());
    unit_ = norm.cwiseInverse();
    auto [values, vectors] =
        numerics::symmetric_eigen(unit_.asDiagonal() * normal * unit_.asDiagonal());
    null_ = (values.array() < zero * values.maxCoeff()).count();
    values_ = std::move(values);
    vectors_ = std::move(vectors);
  }

  /// Returns a motion's value for the search: the logarithm of the determinant. With links unknown,
  /// a term favours a small condition number.
  [[nodiscard]] double value(bool links) const {
    const double rank = static_cast<double>(values_.size() - null_);
    return log_determinant_ - (links ? condition_weight * rank * std::log(condition()) : 0);
  }

  /// Sets the condition and the predicted widths.
  void predict(const Parameters& parameters, Excitation& to) const {
    const Eigen::Index rank = values_.size() - null_;
    to.condition = condition();
    for (Eigen::Index i = 0; i < unit_.size(); ++i) {
      const auto& entry = parameters.entries()[static_cast<std::size_t>(i)];
      if (entry.kind == Kind::inertia) continue;
      const bool alone = vectors_.row(i).head(null_).squaredNorm() < 1e-6;
      const double deviation =
          unit_[i] *
          std::sqrt(vectors_.row(i).tail(rank).cwiseAbs2().dot(values_.tail(rank).cwiseInverse()));
      to.widths.push_back({entry.name, entry.unit,
                           alone ? 1.96 * deviation : std::numeric_limits<double>::infinity()});
    }
  }

 private:
  [[nodiscard]] double condition() const { return std::sqrt(values_.maxCoeff() / values_[null_]); }

  // Eigenvalues and eigenvectors of the normal matrix of columns scaled by `unit_`. The first
  // `null_` eigenvalues count as zero.
  VectorXd unit_, values_;
  MatrixXd vectors_;
  Eigen::Index null_ = 0;
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
        rows_(static_cast<Eigen::Index>(std::round(goal.duration_s / row_s)) + 1) {
    if (goal.shapes.empty()) return;
    try {
      links_.emplace(scenario, goal.shapes);
    } catch (const std::invalid_argument& problem) {
      throw scenario.complaint("robot.urdf", "{}", problem.what());
    }
    const auto start = links_->nearest(scenario.plant.initial.position_rad);
    if (!start || start->distance >= goal.clearance) return;
    throw scenario.complaint("plant.initial.position_rad",
                             "links {} and {} are {:.3g} m from each other at the start; begin "
                             "elsewhere, or give a smaller --clearance than {:g}",
                             start->a, start->b, start->distance, goal.clearance);
  }

  /// Searches for the motion of the largest value.
  /// @return false if no motion keeps the limits
  bool search(const Report& report) {
    std::mt19937 random(1);
    const Eigen::Index n = scenario_.num_joints;
    VectorXd size = VectorXd::Constant(n, first_size);
    const int last = draws + (seeks_links() ? changes_with_links : changes);
    for (int i = 0; i < last; ++i) {
      if (!found_ && i == most_draws) return false;
      if (i % 100 == 0) report(fmt::format("motion {} of {}", i + 1, last));
      const Eigen::Index j = i % n;
      Series next = best_;
      if (i < draws || !found_) {
        next = {MatrixXd(2 * harmonics, n), VectorXd::Ones(n)};
        for (Eigen::Index each = 0; each < n; ++each) {
          next.coefficient.col(each) = drawn_coefficients(random);
        }
        consider(next);
      } else {
        change(next, j, size[j], random);
        size[j] = std::clamp((consider(next) ? growth : decrease) * size[j], least_size, most_size);
      }
    }
    return found_;
  }

  /// Returns the best motion, if it keeps the limits at every 10 ms as well.
  [[nodiscard]] std::optional<Excitation> best() {
    const std::optional<Shrunk> kept = within_limits(best_, fine_s);
    if (!kept) return {};
    const auto& [offset, motion] = *kept;
    const VectorXd& start = scenario_.plant.initial.position_rad;
    Excitation result{overrides_of(offset, start, scenario_.loop.period_s),
                      {},
                      0,
                      offset.cwiseAbs().colwise().maxCoeff().transpose(),
                      motion.speed,
                      motion.torque,
                      nearest(motion),
                      {}};
    if (links_) result.not_compared = links_->meeting();
    information(motion, noise_).predict(parameters_, result);
    return result;
  }

  /// Throws the reason why the last motion was not allowed.
  [[noreturn]] void refuse() const {
    if (below_floor_) {
      throw scenario_.complaint("plant.initial.position_rad",
                                "no motion keeps the links' origins above {:g} m; begin higher, or "
                                "give a smaller --reach",
                                *goal_.floor);
    }
    if (too_near_) {
      throw scenario_.complaint("plant.initial.position_rad",
                                "no motion keeps links {} and {} {:g} m from each other ({:.3g} m "
                                "in the last one); give a smaller --reach or --clearance",
                                too_near_->a, too_near_->b, goal_.clearance, too_near_->distance);
    }
    throw scenario_.complaint(
        "plant.drive.torque_limit_Nm",
        "holding the arm at its start takes four fifths of it or more; begin nearer to upright or "
        "hanging");
  }

 private:
  [[nodiscard]] bool seeks_links() const { return parameters_.first(Kind::inertia) >= 0; }

  /// A motion that keeps the limits.
  struct Shrunk {
    MatrixXd offset;  ///< from the start, a row per waypoint
    Motion motion;
  };

  /// Returns the motion made smaller until it keeps the limits; nothing if that does not suffice.
  std::optional<Shrunk> within_limits(const Series& series, double sample_s) {
    MatrixXd offset = offsets(series, most_, rows_);
    constexpr int most_passes = 12;
    for (int pass = 0; pass < most_passes; ++pass) {
      Motion motion = motion_of(moving(offset), sample_s);
      const VectorXd factor = shrink(scenario_, motion);
      if (factor.minCoeff() < 1) {
        offset = offset * (0.99 * factor).cwiseMin(1).asDiagonal();
        continue;
      }
      below_floor_ = goal_.floor && lowest(motion) < *goal_.floor;
      too_near_ = nearest(motion);
      if (too_near_ && too_near_->distance >= goal_.clearance) too_near_.reset();
      if (!below_floor_ && !too_near_) return Shrunk{std::move(offset), std::move(motion)};
      offset *= 0.8;
    }
    return {};
  }

  /// Takes a motion if it has a larger value than the best one so far.
  /// @return whether it is taken
  bool consider(const Series& series) {
    const std::optional<Shrunk> kept = within_limits(series, coarse_s);
    if (!kept) return false;
    if (noise_.size() == 0) noise_ = noise_of(kept->motion);
    const VectorXd noise = seeks_links() ? noise_ : noise_of_search(kept->motion);
    const double value = information(kept->motion, noise).value(seeks_links());
    if (found_ && value <= most_value_) return false;
    most_value_ = value;
    best_ = series;
    found_ = true;
    return true;
  }

  [[nodiscard]] Information information(Motion motion, const VectorXd& noise) const {
    motion.recording.tau.rowwise() = motion.torque.transpose();
    return {regression(motion.recording, parameters_), parameters_, noise};
  }

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

  /// Returns the noise with which motions are compared: the geometric mean of the predictions'
  /// noise and of that share of the motion's own largest torque. Errors of measured torques grow
  /// with the range of the sensor and with the torque.
  [[nodiscard]] VectorXd noise_of_search(const Motion& motion) const {
    return noise_.cwiseProduct((noise_share * motion.torque).cwiseMax(1e-9)).cwiseSqrt();
  }

  /// Returns the least height of a link's origin above the root link's.
  [[nodiscard]] double lowest(const Motion& motion) const {
    double least = std::numeric_limits<double>::infinity();
    const robot::Model& model = *scenario_.model;
    const Eigen::Vector3d up = -model.gravity.normalized();
    for (Eigen::Index k = 0; k < motion.recording.q.rows(); ++k) {
      const Vector q = motion.recording.q.row(k).transpose();
      for (const auto& [name, frame] : model.frames) {
        if (frame.body >= 0) least = std::min(least, up.dot(robot::frame_pose(model, frame, q).p));
      }
    }
    return least;
  }

  /// Returns the links that come nearest to each other; nothing without shapes.
  [[nodiscard]] std::optional<Separation::Pair> nearest(const Motion& motion) const {
    std::optional<Separation::Pair> result;
    if (!links_) return result;
    for (Eigen::Index k = 0; k < motion.recording.q.rows(); ++k) {
      const auto at = links_->nearest(motion.recording.q.row(k).transpose());
      if (at && (!result || at->distance < result->distance)) result = at;
    }
    return result;
  }

  const scenario::Scenario& scenario_;
  const Parameters& parameters_;
  const ExcitationGoal& goal_;
  std::optional<Separation> links_;
  VectorXd most_, noise_;
  Eigen::Index rows_;
  Series best_;
  double most_value_ = 0;
  bool found_ = false, below_floor_ = false;
  std::optional<Separation::Pair> too_near_;
};

}  // namespace

Excitation excite(const scenario::Scenario& scenario, const std::vector<Kind>& unknown,
                  const ExcitationGoal& goal, const Report& report) {
  if (scenario.robot.flexible) throw scenario.complaint("robot.joints", "flexible; needed: rigid");
  const Parameters parameters(scenario, unknown);
  Designer designer(scenario, parameters, goal);
  if (designer.search(report)) {
    if (std::optional<Excitation> best = designer.best()) return *std::move(best);
  }
  designer.refuse();
}

}  // namespace tachless::identify
