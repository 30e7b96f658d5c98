#include "lyapunov/stability_certificate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <utility>

#include "controller/law/loria_ortega_adaptive.h"
#include "linear/scenario_loop.h"
#include "lyapunov/examined_weights.h"
#include "lyapunov/law_loop.h"
#include "lyapunov/weighted_region.h"
#include "numerics/decompositions.h"
#include "reference/make_trajectory.h"
#include "robot/dynamics.h"
#include "robot/model.h"

namespace tachless::lyapunov {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

bool equal(const VectorXd& a, const VectorXd& b) { return a.size() == b.size() && a == b; }

/// The loop in error coordinates, where it starts, and the search for weights of V.
class ErrorLoop {
 public:
  explicit ErrorLoop(const scenario::Scenario& scenario)
      : scenario_(scenario),
        model_(error_model(scenario)),
        loop_(law_loop(scenario).value()),
        velocity_(velocity_bound(scenario)),
        q_(scenario.plant.initial.position_rad),
        friction_(friction_torques(scenario, velocity_.each)),
        circle_(VectorXd::Constant(scenario.num_joints, infinity)) {
    for (Eigen::Index i = 0; i < circle_.size(); ++i) {
      const auto type = model_.joint_types[static_cast<std::size_t>(i)];
      if (type == robot::JointType::revolute) circle_[i] = std::numbers::pi;
    }
    if (loop_.systems[0].rotor_inertia.size() > 0) friction_ = {};
    const reference::Trajectory trajectory = reference::make_trajectory(scenario);
    range_ = beside_the_motion(scenario, trajectory);
    if (!torque_limited()) return;
    for (const double t_s : reference::Motion(scenario, trajectory).closely(64, most_errors)) {
      on_the_way_.push_back(trajectory.at(t_s));
    }
  }

  [[nodiscard]] const ErrorSystem& system() const { return loop_.systems[0]; }
  [[nodiscard]] const std::optional<Weights>& own_weights() const { return loop_.weights; }
  [[nodiscard]] const robot::Model& model() const { return model_; }
  [[nodiscard]] double B_d() const { return velocity_.speed; }
  [[nodiscard]] bool disturbed() const { return friction_.any(); }
  [[nodiscard]] double V0(const Weights& weights) const {
    return lyapunov_value(system(), weights, model_, q_, loop_.initial);
  }
  /// Returns the certificate at a constant reference, where V without cross terms does not rise. A
  /// start from which a prismatic joint may reach the end of its range has none.
  [[nodiscard]] CertifiedStart held_start() const {
    Region region;
    region.feedback = (system().kp + system().kd * system().b.asDiagonal()).diagonal().cwiseSqrt();
    const Region of_1 = of_1_J(region, {});
    if ((of_1.e_reached.array() * std::sqrt(V0({})) >= range_.array()).any()) {
      return {.decided = true, .certified = false, .proved = false, .torque_share = {}};
    }
    CertifiedStart held{.decided = true, .certified = true, .proved = true, .torque_share = {}};
    if (torque_limited()) held.torque_share = torque_share(of_1, V0({})).maxCoeff();
    return held;
  }
  /// Returns true if the certified results hold for all postures.
  [[nodiscard]] bool proved() { return fine().postures.proved; }

  /// Returns the best region for a goal. The search is over few postures, to which the binding
  /// postures are added. The result is then certified over many postures. A law with weights of its
  /// own keeps them.
  /// @param from as of `best_weights`
  std::optional<CertifiedRegion> best(Goal goal, const std::optional<Weights>& from = {}) {
    return completed(found(goal, from));
  }

  /// Returns the region with the largest errors at rest (their product): of every posture or, where
  /// postures are sampled, of a tube about the reference. A wider tube allows smaller errors. The
  /// best width is where both are equal; it is found by halving in logarithms. The width is first
  /// found by the few postures of the search. The region is then certified over many postures, in
  /// this tube and in those to which the certified regions lead.
  /// @param known a region of every posture, if any is known: the result is not less
  std::optional<CertifiedRegion> largest(const std::optional<CertifiedRegion>& known) {
    const bool from_known = known && !proved();  // else a grid of weights costs little
    auto result = found(Goal::level, from_known ? std::optional(known->weights) : std::nullopt);
    if (proved() || circle_.size() > most_joints_of_certified_run) return completed(result);
    if (errors_at_rest(known) > errors_at_rest(result)) result = known;
    constexpr double first_width = 0.3;  // [rad; m]
    const VectorXd first = result ? VectorXd(errors_of(*result).cwiseMin(circle_))
                                  : VectorXd::Constant(circle_.size(), first_width);
    std::optional<Weights> from = result ? std::optional(result->weights) : std::nullopt;
    const auto tried = fitted([&] { return searched(from); }, from, first, result);
    if (tried && tried->tube.size() > 0) {
      const auto certify = [&] { return found(Goal::level, from); };
      result = fitted(certify, from, tried->tube, result);
    }
    look_within(result ? result->tube : VectorXd());
    return completed(result);
  }

 private:
  /// Returns the sum of the logarithms of the errors at rest, by which regions are compared.
  static double errors_at_rest(const std::optional<CertifiedRegion>& c) {
    return c ? c->region.e_at_rest.array().log().sum() : -infinity;
  }
  /// Returns how far the links' errors reach in the region.
  [[nodiscard]] VectorXd errors_of(const CertifiedRegion& c) const {
    return c.region.e_reached.head(circle_.size());
  }

  /// Returns `best` without what `completed` adds.
  std::optional<CertifiedRegion> found(Goal goal, std::optional<Weights> from) {
    Vector forbids;
    if (loop_.weights) return certified(*loop_.weights, forbids);
    MatrixCondition coarse = coarse_condition(), middle = middle_condition(proved());
    constexpr int rounds = 4;  // the posture that forbids what was found joins the search
    for (int k = 0; k < rounds; ++k) {
      const auto best = best_weights(coarse, middle, goal, from);
      keep_postures_of(coarse);
      if (!best) return {};
      if (auto result = certified(best->weights, forbids)) return result;
      if (forbids.size() == 0) return {};
      from = best->weights;
      for (MatrixCondition* each : {&coarse, &middle}) each->postures.add(forbids);
    }
    return {};
  }

  /// Looks for the tube that is as wide as its region, from `tube` on. Returns the largest region
  /// of `result` and those that `look` returned.
  /// @param from receives that region's weights, from which the next search begins
  template <class Look>
  std::optional<CertifiedRegion> fitted(const Look& look, std::optional<Weights>& from,
                                        VectorXd tube, std::optional<CertifiedRegion> result) {
    constexpr int rounds = 6;
    // The width is found to 5 %. The errors at rest are then within about 5 % of the largest ones.
    constexpr double agrees = 0.05;  // of the width's logarithm
    constexpr int most_in_vain = 2;  // regions in a row that are no larger
    int in_vain = 0;
    for (int round = 0; round < rounds && tube != circle_; ++round) {
      look_within(tube);
      const std::optional<CertifiedRegion> found = look();
      const bool larger = errors_at_rest(found) > errors_at_rest(result);
      if (larger) result = found;
      if (found) in_vain = larger ? 0 : in_vain + 1;
      if (in_vain == most_in_vain) break;
      from = result ? std::optional(result->weights) : std::nullopt;
      if (found) {
        const double beyond = found->beyond_tube;
        if (std::abs(std::log(beyond)) < agrees) break;
        tube = errors_of(*found) * (std::max(1.0, beyond) / std::sqrt(beyond));
        tube = tube.cwiseMin(circle_).eval();
      } else if (!result) {
        tube /= 3;
      } else if (result->tube.size() > 0) {
        tube = (tube.array() * result->tube.array()).sqrt().matrix().eval();
      } else {
        break;
      }
    }
    return result;
  }

  /// From here on only postures so near the reference; empty: all.
  void look_within(const VectorXd& tube) {
    if (equal(tube, tube_)) return;
    if ((tube.size() == 0) != (tube_.size() == 0)) kept_.clear();
    tube_ = tube;
    examined_.reset();
    fine_.reset();
    centres_.clear();
    if (tube.size() == 0) return;
    constexpr int instants = 257;
    for (const messages::ReferencePoint& r :
         linear::ScenarioLoop(scenario_).rest_points(instants)) {
      centres_.push_back(r.q_ref);
    }
  }

  /// Returns how far each error may go, anywhere along the motion, before a prismatic joint is at
  /// the end of its range [rad; m]. Infinite for revolute joints.
  static VectorXd beside_the_motion(const scenario::Scenario& scenario,
                                    const reference::Trajectory& trajectory) {
    const robot::Model& model = *scenario.model;
    VectorXd range = VectorXd::Constant(model.num_joints, infinity);
    for (const double t_s : reference::Motion(scenario, trajectory).closely()) {
      const Vector q = trajectory.at(t_s).q_ref;
      for (Eigen::Index i = 0; i < range.size(); ++i) {
        if (model.joint_types[static_cast<std::size_t>(i)] == robot::JointType::revolute) continue;
        range[i] = std::min({range[i], q[i] - model.lower[i], model.upper[i] - q[i]});
      }
    }
    return range;
  }

  /// The conditions of a search at the present tube. A condition costs little without `refine` and
  /// bounds.
  [[nodiscard]] MatrixCondition coarse_condition() const {
    MatrixCondition coarse = condition({}, postures({.circle_points = 24, .samples = few_samples}));
    for (const Beside& each : kept_) {
      coarse.postures.add(tube_.size() == 0 ? each.centre
                                            : Vector(each.centre + each.share.cwiseProduct(tube_)));
    }
    for (std::size_t i = 0; i < loop_.systems.size(); i += 4) {
      coarse.systems.push_back(loop_.systems[i]);
    }
    return coarse;
  }
  /// Keeps the postures that joined a search last, for the next ones.
  void keep_postures_of(const MatrixCondition& coarse) {
    constexpr std::size_t most = 6;
    const numerics::Postures& postures = coarse.postures;
    if (postures.kind != numerics::Postures::Kind::sampled) return;
    kept_.clear();
    const std::size_t count = postures.q.size();
    for (std::size_t i = std::max<std::size_t>(few_samples, count - most); i < count; ++i) {
      Beside kept{postures.q[i], {}};
      if (tube_.size() > 0) {
        const numerics::Box box = postures.box_around(postures.q[i]);
        kept.centre = (box.lower + box.upper) / 2;
        kept.share = (postures.q[i] - kept.centre).cwiseQuotient(tube_);
      }
      kept_.push_back(std::move(kept));
    }
  }
  [[nodiscard]] MatrixCondition middle_condition(bool bounded) {
    return condition(loop_.systems, bounded
                                        ? fine().postures
                                        : postures({.circle_points = 90, .samples = samples(128)}));
  }

  /// Returns the region of the largest level over the few postures of the search. It is not
  /// certified. Precondition: postures are sampled.
  std::optional<CertifiedRegion> searched(const std::optional<Weights>& from) {
    const MatrixCondition middle = middle_condition(false);
    if (loop_.weights) {
      const auto region = middle.region(*loop_.weights);
      return region ? within_bounds(*loop_.weights, *region) : std::nullopt;
    }
    MatrixCondition coarse = coarse_condition();
    const auto found = best_weights(coarse, middle, Goal::level, from);
    keep_postures_of(coarse);
    return found ? within_bounds(found->weights, found->region) : std::nullopt;
  }

  /// Returns the certified region of these weights, without what `completed` adds.
  /// @param forbids receives the posture at which nothing is certified; empty: there is none
  std::optional<CertifiedRegion> certified(const Weights& weights, Vector& forbids) {
    forbids = {};
    const auto region = examined(weights).region_without_ball(&forbids);
    if (!region) return {};
    auto result = within_bounds(weights, *region);
    if (!result) return {};
    // The search for the slowest posture may find one at which V grows that the region's missed.
    const numerics::Extreme slowest = examined(weights).slowest(0);
    if (!(slowest.value > 0)) {
      forbids = slowest.q;
      return {};
    }
    // V of a law with an integral lacks the integral's part: its Vdot <= -mu V certifies no rate.
    result->rate = loop_.weights ? 0 : slowest.value;
    return result;
  }

  /// Adds to a certified region of the present tube what no search for a region compares.
  std::optional<CertifiedRegion> completed(std::optional<CertifiedRegion> found) {
    if (!found) return found;
    CertifiedRegion& result = *found;
    if (result.region.ball == 0) {
      result.region.ball = examined(result.weights).ball(result.region.level);
    }
    const double room = result.region.level - result.V0;
    if (loop_.weights) {
      result.unknown_torque =
          (2 * std::max(room, 0.0) * loop_.ki).cwiseSqrt().cwiseMin(loop_.d_max);
      // 1/2 z' Ki^-1 z with |z| <= d_max + |d| <= 2 d_max, whatever happened before
      const double most = 2 * loop_.d_max.cwiseAbs2().cwiseQuotient(loop_.ki).sum();
      if (std::isfinite(most)) result.integral_share = most / result.region.level;
    }
    // From V0 on, |delta| stays below sqrt(2 w V).
    if (result.holds_initial_state()) {
      const double delta = std::sqrt(2 * result.region.w * result.V0);
      result.rate_from_start =
          loop_.weights || delta == 0 ? result.rate : examined(result.weights).slowest(delta).value;
    }
    result.torque = torque(result);
    if (friction_.any() && std::isfinite(result.region.level)) {
      result.friction_error = ultimate(result);
    }
    return found;
  }

  /// Returns the part of a region in which no prismatic joint reaches the end of its range, no
  /// error the tube's end, and the law's feedback is linear; and V at the start. Returns nothing
  /// where a prismatic joint's reference is at the end of its range.
  [[nodiscard]] std::optional<CertifiedRegion> within_bounds(const Weights& weights,
                                                             Region region) const {
    const bool endless = !std::isfinite(region.level) && range_.array().isFinite().any();
    if (endless) region = of_1_J(region, weights);
    const VectorXd reached = region.e_reached.head(range_.size());
    double beyond_range = 0;
    for (Eigen::Index i = 0; i < range_.size(); ++i) {
      if (!std::isfinite(range_[i])) continue;
      if (!(range_[i] > 0)) return {};
      beyond_range = std::max(beyond_range, reached[i] / range_[i]);
    }
    if (endless || beyond_range >= 1) region = scaled(region, (1 - 1e-9) / beyond_range);
    CertifiedRegion result;
    result.starts_in_tube =
        (loop_.initial.head(range_.size()).array().abs() <= range_.array()).all();
    result.tube = tube_;
    for (Eigen::Index i = 0; i < tube_.size(); ++i) {
      if (tube_[i] == circle_[i]) continue;
      result.beyond_tube = std::max(result.beyond_tube, region.e_reached[i] / tube_[i]);
      result.starts_in_tube &= std::abs(loop_.initial[i]) <= tube_[i];
    }
    if (result.beyond_tube >= 1) region = scaled(region, (1 - 1e-9) / result.beyond_tube);
    static_cast<Certified&>(result) = {weights, of_linear_feedback(region, weights)};
    result.V0 = V0(weights);
    return result;
  }

  /// Returns the region within the level up to which the law's feedback is linear.
  [[nodiscard]] Region of_linear_feedback(Region region, const Weights& weights) const {
    const VectorXd& linear = loop_.linear_feedback;
    if (linear.size() == 0) return region;
    const bool endless = !std::isfinite(region.level);
    if (endless) region = of_1_J(region, weights);
    const double beyond =
        std::sqrt(2 * region.level) * region.feedback.cwiseQuotient(linear).maxCoeff();
    return endless || beyond >= 1 ? scaled(region, (1 - 1e-9) / beyond) : region;
  }

  /// Returns the region whose level is the square of `part` times the region's level.
  static Region scaled(Region region, double part) {
    region.level *= part * part;
    region.rho *= part;
    region.ball *= part;
    for (VectorXd* each : {&region.e_at_rest, &region.edot, &region.e_reached}) *each *= part;
    return region;
  }

  /// Numbers of postures; those of `numerics::PostureOptions` that differ between the conditions.
  struct Density {
    int circle_points = 0, samples = 0;
    bool bound_between = false;
  };
  [[nodiscard]] numerics::Postures postures(const Density& density) const {
    return numerics::Postures(model_, {.circle_points = density.circle_points,
                                       .bound_between = density.bound_between,
                                       .samples = density.samples,
                                       .centres = centres_,
                                       .reach = tube_});
  }
  [[nodiscard]] MatrixCondition condition(std::vector<ErrorSystem> systems,
                                          numerics::Postures postures, bool refine = false) const {
    return {.systems = std::move(systems),
            .postures = std::move(postures),
            .B_d = unit(),
            .refine = refine,
            .v_scale = velocity_.scale};
  }

  /// The region at a level of 1 J. Precondition: weights of 0, or an inertia that is the same at
  /// all postures.
  [[nodiscard]] Region of_1_J(Region region, const Weights& weights) const {
    const MatrixXd M = robot::mass_matrix(model_, q_);
    region.level = 1;
    region.edot = (2 * system().inertia(M).diagonal().cwiseInverse()).cwiseSqrt();
    region.ball =
        std::sqrt(2 / numerics::largest_eigenvalue(lyapunov_matrix(system(), weights, M)));
    region.e_at_rest = (2 * system().kp.diagonal().cwiseInverse()).cwiseSqrt();
    region.e_reached = VectorXd::Zero(q_.size());
    for (const ErrorSystem& each : loop_.systems) {
      const MatrixXd inverse = 2 * numerics::inverse(lyapunov_matrix(each, weights, M));
      region.e_reached = region.e_reached.cwiseMax(inverse.diagonal().head(q_.size()).cwiseSqrt());
    }
    return region;
  }

  /// Returns the share of each joint's limit that the torque may take where V <= level.
  [[nodiscard]] VectorXd torque_share(const Region& region, double level) const {
    const VectorXd reach =
        (region.e_reached * std::sqrt(level / region.level)).cwiseMin(std::numbers::pi);
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> part(-1, 1);
    VectorXd torque = VectorXd::Zero(reach.size());
    const std::size_t errors = most_errors / on_the_way_.size();
    for (std::size_t k = 0; k < on_the_way_.size() * errors; ++k) {
      const messages::ReferencePoint& r = on_the_way_[k / errors];
      Vector q = r.q_ref;
      for (Eigen::Index i = 0; i < q.size(); ++i) q[i] += reach[i] * part(random);
      VectorXd each = robot::inverse_dynamics(model_, q, r.v_ref, r.a_ref).cwiseAbs();
      if (const auto& friction = scenario_.controller.friction; friction.given()) {
        each += friction.viscous.cwiseProduct(r.v_ref.cwiseAbs()) +
                friction.largest_dry(robot::gravity_torque(model_, r.q_ref));
      }
      torque = torque.cwiseMax(each);
    }
    VectorXd feedback = region.feedback;
    if (loop_.ki.size() > 0) feedback = (feedback.cwiseAbs2() + loop_.ki).cwiseSqrt();
    torque += std::sqrt(2 * level) * feedback;
    const VectorXd share = torque.cwiseQuotient(VectorXd(*scenario_.plant.drive.torque_limit_Nm));
    const bool bounded = loop_.linear_feedback.size() > 0;  // the law itself keeps the limits
    return bounded ? VectorXd(share.cwiseMin(1)) : share;
  }
  [[nodiscard]] bool torque_limited() const {
    const auto& limit = scenario_.plant.drive.torque_limit_Nm;
    return !scenario_.robot.flexible && limit && limit->array().isFinite().any();
  }
  [[nodiscard]] std::optional<CertifiedRegion::Torque> torque(const CertifiedRegion& c) const {
    if (!torque_limited()) return {};
    Region region = c.region;
    const auto most = [&](double level) { return torque_share(region, level).maxCoeff(); };
    if (!std::isfinite(region.level)) {
      region = of_1_J(region, c.weights);
      constexpr int doublings = 200;  // of the errors: beyond 1e60 rad no limit is reached
      for (int k = 0; k < doublings && most(region.level) <= 1; ++k) region = scaled(region, 2);
    }
    const auto within = [&](double root) { return most(region.level * root * root) <= 1; };
    const double root = within(1) ? 1 : linear::edge(0, 1, 30, within);
    CertifiedRegion::Torque result{region.level * (root * root), region.e_at_rest * root, 0, {}};
    if (c.holds_initial_state()) result.share = most(c.V0);
    torque_share(region, result.level).maxCoeff(&result.joint);
    return result;
  }

  /// Returns bounds of the errors that remain after a start within a quarter of the level. They
  /// follow from Vdot <= -mu V + sqrt(2 V) s + power with V = 1/2 y' M y + 1/2 (e, nu)' S (e, nu).
  /// Empty: nothing is certified. A law with an integral has no such bounds: its part of V does not
  /// decay at mu.
  VectorXd ultimate(const CertifiedRegion& c) {
    if (loop_.weights) return {};
    const double mu = examined(c.weights).slowest(c.region.rho / 2).value;
    if (!(mu > 0)) return {};
    double of_y = 0;
    for (const numerics::Inertia& at : fine().postures.inertia) {
      const MatrixXd inverse = numerics::inverse(at.M);
      of_y = std::max(of_y, friction_.on_y.dot(inverse.cwiseAbs() * friction_.on_y));
    }
    double of_delta = 0;
    for (const ErrorSystem& each : loop_.systems) {
      const MatrixXd L = delta_scale(each, c.weights);
      of_delta = std::max(of_delta, (L.transpose() * friction_.on_delta).norm());
    }
    const double s = std::sqrt(of_y) + std::sqrt(c.region.w) * of_delta;
    const double root =
        (std::sqrt(2) * s + std::sqrt(2 * s * s + 4 * mu * friction_.power)) / (2 * mu);
    if (root * root > c.region.level / 4) return {};
    return c.region.e_reached * (root / std::sqrt(c.region.level));
  }

  /// |scale^-1 v_ref|, if it moves.
  [[nodiscard]] double unit() const { return velocity_.speed > 0 ? 1 : 0; }
  /// Fewer postures where each is looked at with many gains.
  [[nodiscard]] int samples(int of_constant) const {
    return loop_.systems.size() == 1 ? of_constant : of_constant / 8;
  }
  const MatrixCondition& fine() {
    if (!fine_) {
      const bool constant = loop_.systems.size() == 1;
      fine_ = condition(loop_.systems,
                        postures({.circle_points = constant ? 360 : 90,
                                  .samples = samples(1024),
                                  .bound_between = constant}),
                        constant);
    }
    return *fine_;
  }
  /// Returns the answers of `fine` for these weights. Those for the last weights are kept.
  const ExaminedWeights& examined(const Weights& weights) {
    if (!examined_ || !equal(examined_->weights().eps_1, weights.eps_1) ||
        !equal(examined_->weights().eps_2, weights.eps_2)) {
      examined_.emplace(fine(), weights);
    }
    return *examined_;
  }

  /// A posture in a tube: centre + share times the tube's width. Without a tube the centre is it.
  struct Beside {
    Vector centre, share;
  };

  static constexpr int few_samples = 12;    ///< postures with which a search begins
  static constexpr int most_errors = 1024;  ///< at which torques are looked at, at most
  const scenario::Scenario& scenario_;
  robot::Model model_;
  LawLoop loop_;
  VelocityBound velocity_;
  Vector q_;  ///< at the start
  FrictionTorques friction_;
  VectorXd circle_;  ///< a tube's width that holds all of a joint's postures
  VectorXd range_;   ///< as of `beside_the_motion`
  VectorXd tube_;    ///< as of CertifiedRegion
  std::vector<Vector> centres_;
  std::vector<Beside> kept_;                          ///< that joined the last search
  std::vector<messages::ReferencePoint> on_the_way_;  ///< where torque limits are looked at
  std::optional<MatrixCondition> fine_;
  std::optional<ExaminedWeights> examined_;  ///< of `fine_`
};

/// Returns whether the unknown parameters of loria_ortega_adaptive can be those of the payload: its
/// mass, first moments and inertia about the frame of the link.
bool is_in_box(const plant::PayloadSpec& payload, const scenario::Gains& gains) {
  const auto gain = [&](const char* name) {
    const auto found = gains.find(name);
    return found == gains.end() ? 0 : found->second[0];
  };
  const auto bound = [&](const char* rate, const char* most) {
    return gain(rate) > 0 ? gain(most) : 0;
  };
  if (!payload.link.empty() || gain("load_joint") != 0) return false;
  const Eigen::Vector3d centre(payload.center_of_mass_m.data());
  const auto& I = payload.inertia_kgm2;
  Eigen::Matrix3d inertia;
  inertia << I[0], I[1], I[2], I[1], I[3], I[4], I[2], I[4], I[5];
  inertia += payload.mass_kg *
             (centre.squaredNorm() * Eigen::Matrix3d::Identity() - centre * centre.transpose());
  return payload.mass_kg <= bound("gamma_mass", "mass_max") &&
         payload.mass_kg * centre.cwiseAbs().maxCoeff() <= bound("gamma_moment", "moment_max") &&
         inertia.cwiseAbs().maxCoeff() <= bound("gamma_inertia", "inertia_max");
}

}  // namespace

std::vector<std::string> provisos(const scenario::Scenario& scenario, bool disturbed) {
  std::vector<std::string> result;
  const auto add = [&](bool there, std::string what) {
    if (there) result.push_back(std::move(what));
  };
  const double payload_kg = scenario.plant.payload.mass_kg;
  const bool adapts = scenario.controller.law == controller::law::LoriaOrtegaAdaptive::name;
  add(payload_kg > 0 && !(adapts && is_in_box(scenario.plant.payload, scenario.controller.gains)),
      fmt::format("the payload of {:g} kg is not in it: {}", payload_kg,
                  adapts ? "it is outside of the box of the unknown parameters"
                         : "the law does not know of it"));
  const auto& drive = scenario.plant.drive;
  const bool viscous = !drive.viscous_friction_Nms_per_rad.isZero(0);
  if (const auto& flexible = scenario.robot.flexible) {
    const bool dry = drive.dry_friction() || !flexible->motor_coulomb_friction_Nm.isZero(0);
    const bool damped =
        viscous || !flexible->motor_damping.isZero(0) || !flexible->spring_damping.isZero(0);
    const bool in_it = has_error_form(scenario.controller.law);
    add(!in_it && (damped || dry), "the friction of joints, motors and springs is not in it");
    add(in_it && dry, "dry friction is not in the region: it disturbs");
    add(in_it && damped &&
            reference::Motion(scenario, reference::make_trajectory(scenario)).moves(),
        "of viscous friction it has the torque on errors; the torque on the reference, which the "
        "law does not know, disturbs");
  } else {
    add(disturbed, viscous && !drive.dry_friction()
                       ? "of viscous friction it has D edot; D v_ref, which the law does not feed "
                         "forward in full (controller.friction), disturbs"
                       : "dry friction is not in the region: it disturbs");
  }
  add(drive.current_loop_hz || !(drive.torque_scale.array() == 1).all(),
      "current loops and the torques' scale (plant.drive) are not in it");
  add(!drive.torque_offset_Nm.isZero(0),
      "the torques' offset (plant.drive) is not in it: it disturbs");
  add(!scenario.plant.encoder.eccentricity_rad.isZero(0),
      "the encoders' eccentricity is not in it");
  add(!scenario.plant.disturbances.empty(), "disturbances are not in it");
  add(!scenario.plant.mujoco.model.empty(), "in free motion: contacts are not in it");
  add(scenario.believed_model != nullptr, "the law's robot (controller.urdf) is not the plant's");
  return result;
}

std::optional<StabilityCertificate> stability_certificate(const scenario::Scenario& scenario,
                                                          linear::Effort effort,
                                                          std::string& why_not,
                                                          const linear::OnProgress& tell) {
  why_not = no_certificate(scenario);
  if (!why_not.empty()) return {};
  ErrorLoop loop(scenario);
  StabilityCertificate result;
  result.B_d = loop.B_d();
  result.own_weights = loop.own_weights().has_value();
  result.constant = result.B_d == 0 && !result.own_weights;
  const bool few = !result.constant && scenario.num_joints <= most_joints_of_certified_run;
  if (few || effort == linear::Effort::full) {
    tell("certified region: fastest rate");
    result.proved = loop.proved();
    result.fastest = loop.best(Goal::rate);
    result.start = {.decided = result.proved || effort == linear::Effort::full,
                    .certified = false,
                    .proved = result.proved,
                    .torque_share = {}};
    add(result.start, result.fastest);
    if (!result.constant && (result.proved || effort == linear::Effort::full)) {
      tell("certified region: largest region");
      result.largest = loop.largest(result.fastest);
      if (result.own_weights) result.fastest = std::exchange(result.largest, {});
    }
    if (result.largest && result.largest->tube.size() > 0) {
      auto near = loop.best(Goal::rate, result.largest->weights);
      if (!near || near->rate < result.largest->rate) near = result.largest;
      const bool start = result.start.certified;  // by the fastest one so far
      if (!start || (holds_start(near) && near->rate > result.fastest->rate)) result.fastest = near;
    }
    if (result.proved || !result.start.certified) {
      add(result.start, result.fastest);
      add(result.start, result.largest);
    }
  }
  if (result.constant) {
    result.start = loop.held_start();
    result.V0 = loop.V0({});
    if (!result.start.certified) {
      result.start.proved = result.proved;
      add(result.start, result.fastest);
    }
  }
  result.provisos = provisos(scenario, loop.disturbed());
  return result;
}

std::optional<PaperConditions> paper_conditions(const scenario::Scenario& scenario,
                                                std::string& why_not) {
  why_not = no_certificate(scenario);
  if (!why_not.empty()) return {};
  const ErrorLoop loop(scenario);
  const RobotConstants constants = robot_constants(loop.model());
  return PaperConditions{constants, printed_conditions(loop.system(), constants, loop.B_d())};
}

std::optional<CertifiedRun> certified_run(const scenario::Scenario& scenario) {
  std::string why_not;
  const auto all = stability_certificate(scenario, linear::Effort::quick, why_not);
  if (!all) return {};
  if (all->constant) {
    return CertifiedRun{{}, all->V0, infinity, 0, true, all->provisos, all->start};
  }
  std::optional<CertifiedRun> best;
  for (const auto& found : {all->fastest, all->largest}) {
    if (!found || (best && found->rate_from_start <= best->rate)) continue;
    best = CertifiedRun{found->weights, found->V0,     found->region.level, found->rate_from_start,
                        all->proved,    all->provisos, all->start};
  }
  return best;
}

}  // namespace tachless::lyapunov
