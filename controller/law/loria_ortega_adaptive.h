#pragma once

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "base/elementary.h"
#include "controller/law/filtered_error.h"

namespace tachless::controller::law {

struct AdaptiveGains {
  Vector kp, kd, a, b;
  double eps_1 = 0, eps_2 = 0;
  double gamma_mass = 0, mass_max = 0;
  double gamma_moment = 0, moment_max = 0;
  double gamma_inertia = 0, inertia_max = 0;
  Vector gamma_friction = {}, friction_max = {};
  int load_joint = 0;
  double w = 0, damping = 0;

  using Self = AdaptiveGains;
  static constexpr std::tuple keys{
      gain_beside_w("kp", &Self::kp, "N m/rad", "Weight of the position error"),
      gain_beside_w("kd", &Self::kd, "N m s/rad", "Weight of the filter output"),
      gain("a", &Self::a, "1/s", "Filter pole"),
      gain("b", &Self::b, "1/s", "Filter gain"),
      gain("eps_1", &Self::eps_1, "1/s", "Weight of e in the adaptation"),
      gain("eps_2", &Self::eps_2, "1", "Weight of nu in the adaptation"),
      base::Key{"gamma_mass", &Self::gamma_mass, "kg^2/J", "Rate of the load's mass; 0: known"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"mass_max", &Self::mass_max, "kg", "Largest mass of the load"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"gamma_moment", &Self::gamma_moment, "kg^2 m^2/J",
                "Rate of the load's mass times its centre; 0: known"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"moment_max", &Self::moment_max, "kg m", "Largest coordinate of that product"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"gamma_inertia", &Self::gamma_inertia, "kg^2 m^4/J",
                "Rate of the load's inertia about the origin of its link's frame; 0: known"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"inertia_max", &Self::inertia_max, "kg m2", "Largest entry of that inertia"}
          .in(base::not_negative)
          .by_default(),
      base::Key{"gamma_friction", &Self::gamma_friction, "N m s^2",
                "Rate of the joints' viscous friction; 0: known"}
          .in(base::not_negative)
          .by_default(0),
      base::Key{"friction_max", &Self::friction_max, "N m s/rad", "Largest viscous friction"}
          .in(base::not_negative)
          .by_default(0),
      base::Key{"load_joint", &Self::load_joint, "joints",
                "Joint whose link carries the load, counted from 1; 0: the leaf link farthest from "
                "the root"}
          .in(base::whole(0, max_joints))
          .by_default(),
      bandwidth_key(&Self::w),
      damping_key(&Self::damping)};
};

/// `LoriaOrtegaRigid` that adapts to a load of unknown mass and centre and to unknown viscous
/// friction, from link positions alone:
///
///   tau = ID(q, v_ref, vdot_ref) + Yd pihat - Kp e - Kd nu,   Yd = Y(q_ref, v_ref, vdot_ref),
///   pihatdot = -Gamma Yd' (edot + eps_1 e - eps_2 nu), projected onto a box.
///
/// Y pi is the torque of the unknown parameters pi, in which the dynamics are linear. These are
/// mass, mass times centre and inertia of the load in its link's frame, and the friction of each
/// joint. The velocity in pihatdot is integrated by parts between ticks, because Yd is known at
/// both ends. `FollowingGains` adds gains that follow the reference to Kp and Kd, where w is given.
class LoriaOrtegaAdaptive : public FollowingGains<LoriaOrtegaAdaptive, AdaptiveGains> {
 public:
  static constexpr std::string_view name = "loria_ortega_adaptive";
  static constexpr std::array signals{Signal{"error", "rad"},          Signal{"nu", "rad/s"},
                                      Signal{"friction", "N m s/rad"}, Signal{"mass", "kg"},
                                      Signal{"moment_x", "kg m"},      Signal{"moment_y", "kg m"},
                                      Signal{"moment_z", "kg m"},      Signal{"inertia", "kg m2"}};
  static constexpr std::string_view source =
      "derived here from A. Loria and R. Ortega, On tracking control of rigid and flexible joint "
      "robots, Appl. Math. and Comp. Sci. 5(2), 1995, eq. 4-5; with the desired regressor of N. "
      "Sadegh and R. Horowitz, Int. J. Robotics Research 9(3), 1990";
  static constexpr std::string_view proved =
      "errors converge with constant unknown parameters, semiglobally, in continuous time";
  static constexpr std::string_view conditions =
      "the matrix condition with the law's own eps_1 and eps_2, and with H in the hull of d(Y "
      "pi)/dq added, for every pi of the box; constant gains; the unknown parameters are constant "
      "and in the box";

  /// Its certificate depends on the box of the unknown parameters (lyapunov::weighted_region).
  static constexpr std::string_view no_certificate =
      "its region depends on the box of the unknown parameters";

  /// Parameter of the load, with its rate of adaptation and its bounds. The parameter's column of Y
  /// is the torque of the massless robot `load[0]` with a load of one kilogram. With a second
  /// robot, the column is half the difference of the two torques.
  struct Column {
    std::vector<robot::Model> load;
    double rate = 0;
    std::array<double, 2> box{};
  };

  /// Mass, three moments and six entries of the inertia.
  static constexpr int most_columns = 10;
  using Columns = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, max_joints,
                                most_columns>;
  using Load = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, most_columns, 1>;
  struct Memory {
    Filter::Memory filter;
    Vector e, delta;  ///< e and delta of the last step
    Columns Y;        ///< Yd of the load at the last step
    Vector v_ref;     ///< Yd of the friction at the last step
    Load load;        ///< estimates [kg, kg m, kg m2]
    Vector friction;  ///< estimates [N m s/rad]

    static constexpr std::string_view no_linearisation =
        "its estimates stay where the reference does not excite them; loria_ortega_rigid with its "
        "kp, kd, a and b has the loop of a constant estimate";
  };

  /// @throw std::invalid_argument if load_joint names no joint with a link.
  LoriaOrtegaAdaptive(robot::Model robot, AdaptiveGains gains, const Settings& settings)
      : FollowingGains(std::move(robot), std::move(gains), settings) {
    for (Vector* each : {&gains_.gamma_friction, &gains_.friction_max}) {
      if (each->size() == 0) *each = this->each(0);
    }
    const Eigen::Vector3d origin = Eigen::Vector3d::Zero();
    const Eigen::Matrix3d point = Eigen::Matrix3d::Zero();
    if (gains_.gamma_mass > 0) {
      add_column({load_of(origin, point)}, gains_.gamma_mass, {0, gains_.mass_max});
    }
    for (int axis = 0; axis < 3 && gains_.gamma_moment > 0; ++axis) {
      const Eigen::Vector3d centre = Eigen::Vector3d::Unit(axis);
      add_column({load_of(centre, point), load_of(-centre, point)}, gains_.gamma_moment,
                 {-gains_.moment_max, gains_.moment_max});
    }
    for (const auto& [i, j] : inertia_entries) {
      if (gains_.gamma_inertia == 0) break;
      Eigen::Matrix3d unit = point;
      unit(i, j) = unit(j, i) = 1;
      add_column({load_of(origin, unit), load_of(origin, -unit)}, gains_.gamma_inertia,
                 {i == j ? 0 : -gains_.inertia_max, gains_.inertia_max});
      if (!turns(columns_.back())) columns_.pop_back();
    }
  }

  /// Computes gains that adapt to a mass of at most 5 kg, at a reach of about one metre.
  static Gains tuned(const Tuning& t) {
    const double eps_1 = t.w / 5;
    Gains gains{t.kp(), t.kd(), t.each(t.filter), t.each(t.filter)};
    gains.eps_1 = eps_1;
    gains.eps_2 = 5 * eps_1 / t.filter;
    // Gravity of the load at a reach of one metre, squared, is 100 (N m/kg)^2.
    gains.gamma_mass = 0.3 * t.kp().minCoeff() / 100;
    gains.mass_max = 5;
    return gains;
  }

  /// Returns the memory with which the first step adapts nothing.
  [[nodiscard]] Memory start(const Measurement& measured, const ReferencePoint& reference) const {
    const Filter::Memory filter = FilteredError::start(measured, reference);
    const Vector e = measured.q - reference.q_ref;
    return {filter,
            e,
            -passive(e, filter_.step(filter, e).nu),
            columns_at(reference, {reference.v_ref, reference.a_ref}),
            reference.v_ref,
            Load::Zero(num_columns()),
            Vector::Zero(e.size())};
  }

  [[nodiscard]] Step<Memory> step(const Memory& memory, const Measurement& measured,
                                  const ReferencePoint& reference) const {
    auto [filter, command, logged] = FilteredError::step(memory.filter, measured, reference);
    const Vector& e = logged.value[0];
    const Vector delta = passive(e, filter.nu);
    const Memory now = adapted(memory, {filter,
                                        e,
                                        delta,
                                        columns_at(reference, {reference.v_ref, reference.a_ref}),
                                        reference.v_ref,
                                        {},
                                        {}});
    const Feedforward lead = ahead(reference);
    command.tau +=
        columns_at(reference, lead).lazyProduct(now.load) + now.friction.cwiseProduct(lead.v_ref);
    messages::LawSignals all{signals.size(), {e, filter.nu, now.friction}};
    std::size_t row = 3;
    Eigen::Index column = 0;
    const auto next = [&](double gamma) { return gamma > 0 ? now.load[column++] : 0; };
    all.value[row++] = each(next(gains_.gamma_mass));
    for (int axis = 0; axis < 3; ++axis) all.value[row++] = each(next(gains_.gamma_moment));
    all.value[row] = each(0);
    for (Eigen::Index i = 0; i < e.size() && column < now.load.size(); ++i) {
      all.value[row][i] = now.load[column++];
    }
    return {now, command, all};
  }

  /// Returns the load's columns of Y at q_ref [N m/kg, 1/s^2].
  [[nodiscard]] Columns columns_at(const ReferencePoint& reference, const Feedforward& of) const {
    Columns Y(reference.q_ref.size(), num_columns());
    for (Eigen::Index i = 0; i < Y.cols(); ++i) {
      Y.col(i) = torque_of(columns_[static_cast<std::size_t>(i)], reference.q_ref, of);
    }
    return Y;
  }

  /// Returns the load's parameters in the order of the estimates.
  [[nodiscard]] const std::vector<Column>& columns() const { return columns_; }
  /// Returns the law's gains; the box of the friction has one entry per joint.
  [[nodiscard]] const Gains& gains() const { return gains_; }

 private:
  void add_column(std::vector<robot::Model> load, double rate, std::array<double, 2> box) {
    columns_.push_back({std::move(load), rate, box});
  }

  [[nodiscard]] Eigen::Index num_columns() const {
    return static_cast<Eigen::Index>(columns_.size());
  }

  /// Returns the torque of a parameter of 1 [N m/kg, 1/s^2].
  [[nodiscard]] static Vector torque_of(const Column& column, const Vector& q,
                                        const Feedforward& of) {
    const auto torque = [&](const robot::Model& model) {
      return robot::inverse_dynamics(model, q, of.v_ref, of.a_ref);
    };
    const Vector first = torque(column.load[0]);
    if (column.load.size() == 1) return first;
    // The two robots differ in this parameter's sign alone: half the difference is its torque.
    return 0.5 * (first - torque(column.load[1]));
  }

  /// Returns whether the motion of the robot depends on that entry of the inertia. In a planar arm
  /// it depends on one entry alone.
  [[nodiscard]] bool turns(const Column& column) const {
    constexpr int postures = 8;
    constexpr double least = 1e-4;  // of an entry that turns at 1 rad/s or 1 rad/s^2: about 1
    const auto some = [&](double phase) -> Vector {
      return 3 * Vector::LinSpaced(robot_.num_joints, phase, 2 * phase + 1).unaryExpr([](double x) {
        return base::sin(x);
      });
    };
    for (int k = 1; k <= postures; ++k) {
      const Vector torque = torque_of(column, some(k), {some(k + 0.3), some(k + 0.7)});
      if (torque.cwiseAbs().maxCoeff() > least) return true;
    }
    return false;
  }

  /// The entries of the inertia in the order of their columns: xx, yy, zz, xy, xz, yz. Entries on
  /// which the motion of the robot does not depend are left out.
  static constexpr std::array<std::pair<int, int>, 6> inertia_entries{
      {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}}};

  /// Returns the robot without mass that carries 1 kg at `centre`, with that inertia about it.
  [[nodiscard]] robot::Model load_of(const Eigen::Vector3d& centre,
                                     const Eigen::Matrix3d& inertia) const {
    robot::Model massless = robot_;
    massless.rotor_inertia = Vector();
    for (robot::Body& body : massless.bodies) static_cast<robot::MassProperties&>(body) = {};
    return robot::with_payload(massless, {1, centre, inertia}, load_link());
  }

  /// Returns the URDF link that carries the load; empty: the leaf link farthest from the root.
  [[nodiscard]] std::string load_link() const {
    if (gains_.load_joint == 0) return {};
    for (const robot::Body& body : robot_.bodies) {
      if (body.coordinate == gains_.load_joint - 1) return body.link;
    }
    throw std::invalid_argument("load_joint is not a joint of the robot");
  }

  /// Returns eps_1 e - eps_2 nu [rad/s].
  [[nodiscard]] Vector passive(const Vector& e, const Vector& nu) const {
    return gains_.eps_1 * e - gains_.eps_2 * nu;
  }

  /// Returns `now` with the estimates after the tick from `before`.
  [[nodiscard]] Memory adapted(const Memory& before, Memory now) const {
    const double h = settings_.period_s;
    const Vector de = now.e - before.e;
    // Gains that a reference brings may have other columns. The estimates then start again.
    const bool known = before.load.size() == num_columns();
    now.load = known ? before.load : Load(Load::Zero(num_columns()));
    for (Eigen::Index i = 0; known && i < num_columns(); ++i) {
      const Column& column = columns_[static_cast<std::size_t>(i)];
      const double work =
          0.5 * (now.Y.col(i) + before.Y.col(i)).dot(de) +
          0.5 * h * (now.Y.col(i).dot(now.delta) + before.Y.col(i).dot(before.delta));
      now.load[i] = std::clamp(now.load[i] - column.rate * work, column.box[0], column.box[1]);
    }
    const Vector work =
        0.5 * (now.v_ref + before.v_ref).cwiseProduct(de) +
        0.5 * h * (now.v_ref.cwiseProduct(now.delta) + before.v_ref.cwiseProduct(before.delta));
    now.friction = (before.friction - gains_.gamma_friction.cwiseProduct(work))
                       .cwiseMax(0)
                       .cwiseMin(gains_.friction_max);
    return now;
  }

  std::vector<Column> columns_;
};

static_assert(OutputFeedbackLaw<LoriaOrtegaAdaptive>);

}  // namespace tachless::controller::law
