#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <utility>

#include "plant/arm_mechanics.h"
#include "plant/dry_friction.h"
#include "robot/dynamics.h"

namespace tachless::plant {
namespace {

constexpr std::size_t max_stages = 6;

/// An explicit Runge-Kutta method with an error estimate (Hairer, Norsett, Wanner, Solving ODEs I,
/// II.4): k_i = f(y + h sum_j a_ij k_j), y+ = y + h sum_i b_i k_i, error = h sum_i e_i k_i.
struct Tableau {
  std::size_t stages;
  int error_order;  ///< error = O(h^error_order)
  std::array<std::array<double, max_stages>, max_stages> a;
  std::array<double, max_stages> b;
  std::array<double, max_stages> e;
};

constexpr Tableau merson = {
    5,
    5,
    {{{}, {1. / 3}, {1. / 6, 1. / 6}, {1. / 8, 0, 3. / 8}, {1. / 2, 0, -3. / 2, 2}}},
    {1. / 6, 0, 0, 4. / 6, 1. / 6},
    // A fifth of the difference to the last stage's argument.
    {(1. / 6 - 1. / 2) / 5, 0, (3. / 2) / 5, (4. / 6 - 2) / 5, (1. / 6) / 5}};

/// Bogacki and Shampine's pair of order 3 and 2.
constexpr Tableau runge_kutta_3 = {4,
                                   3,
                                   {{{}, {1. / 2}, {0, 3. / 4}, {2. / 9, 1. / 3, 4. / 9}}},
                                   {2. / 9, 1. / 3, 4. / 9, 0},
                                   {2. / 9 - 7. / 24, 1. / 3 - 1. / 4, 4. / 9 - 1. / 3, -1. / 8}};

constexpr Tableau fehlberg = {6,
                              5,
                              {{{},
                                {1. / 4},
                                {3. / 32, 9. / 32},
                                {1932. / 2197, -7200. / 2197, 7296. / 2197},
                                {439. / 216, -8, 3680. / 513, -845. / 4104},
                                {-8. / 27, 2, -3544. / 2565, 1859. / 4104, -11. / 40}}},
                              {16. / 135, 0, 6656. / 12825, 28561. / 56430, -9. / 50, 2. / 55},
                              {16. / 135 - 25. / 216, 0, 6656. / 12825 - 1408. / 2565,
                               28561. / 56430 - 2197. / 4104, -9. / 50 + 1. / 5, 2. / 55}};

const Tableau& tableau(Integrator method) {
  switch (method) {
    case Integrator::runge_kutta_merson:
      return merson;
    case Integrator::runge_kutta_3:
      return runge_kutta_3;
    case Integrator::runge_kutta_feldberg:
      return fehlberg;
    default:
      throw std::invalid_argument(
          "native mechanics have runge_kutta_merson, runge_kutta_3 and runge_kutta_feldberg; take "
          "one of them, or plant.mechanics: simbody");
  }
}

robot::Model without_rotors(robot::Model model) {
  model.rotor_inertia.resize(0);  // `ArmMechanics` adds it
  return model;
}

DryFriction friction_of(const DriveSpec& drive) {
  if (!drive.dry_friction()) return {};
  return {drive.coulomb_friction_Nm, drive.static_friction_Nm.value_or(drive.coulomb_friction_Nm),
          drive.stribeck_velocity_rad_per_s};
}

/// The recursions of robot/, which control laws use too, dry friction, and the methods above.
class NativeArm final : public ArmMechanics {
 public:
  NativeArm(const robot::Model& model, const ArmOptions& options, const ArmState& initial)
      : ArmMechanics(model, options, initial),
        equations_(without_rotors(model)),
        friction_(friction_of(options.drive)),
        method_(tableau(options.integrator.method)),
        accuracy_(options.integrator.accuracy),
        xddot_(x.size()) {
    rate_.fill(xddot_);
    acceleration_.fill(xddot_);
  }

  [[nodiscard]] std::int64_t steps() const override { return steps_; }

  Coordinates acceleration() override {
    const DryFriction friction = friction_;
    choose_sticking();
    Coordinates xddot = ArmMechanics::acceleration();
    friction_ = friction;
    return xddot;
  }

  void advance(double time_s) override {
    if (step_s_ == 0) step_s_ = time_s - now_s;
    choose_sticking();
    for (int taken = 0; now_s < time_s; ++taken) {
      if (taken >= max_steps_per_advance) throw too_many_steps();
      take_step(time_s);
    }
  }

 private:
  Links evaluate(const double* q, const double* v) override {
    position_ = Eigen::Map<const robot::Vector>(q, tau.size());
    velocity_ = Eigen::Map<const robot::Vector>(v, tau.size());
    equations_.evaluate(position_, velocity_);
    return {equations_.M, equations_.bias};
  }
  void solve(const double* v, robot::Vector& rhs) override {
    friction_.solve(equations_.M, v, rhs);
  }

  /// Which joints stick from now on.
  void choose_sticking() {
    if (!friction_.present()) return;
    friction_.stick(xdot.data());
    accelerate(now_s, x.data(), xdot.data(), xddot_.data());
    friction_.release();
  }

  /// One accepted or refused step, to `end_s` at most.
  void take_step(double end_s) {
    // The end of the interval cuts a step short; what was found about its length stays.
    const bool last = now_s + step_s_ * (1 + 1e-12) >= end_s;
    const double h = last ? end_s - now_s : step_s_;
    if (!(now_s + h > now_s)) {
      throw std::runtime_error("the accuracy cannot be reached with any step");
    }
    const double error = evaluate(h);
    // A step whose error is not a number is refused like one that is too long.
    const bool accepted = error <= accuracy_;
    const double factor = error > 0 || !std::isfinite(error)
                              ? 0.9 * std::pow(accuracy_ / error, 1.0 / method_.error_order)
                              : max_growth;
    const double wanted = h * (std::isfinite(factor) ? std::clamp(factor, 0.1, max_growth) : 0.1);
    if (!accepted) {
      step_s_ = wanted;
      return;
    }
    if (!last || wanted > step_s_ || wanted < h) step_s_ = wanted;
    const double taken = until_change(h);
    x = next_x_;
    xdot = next_xdot_;
    now_s = last && taken == h ? end_s : now_s + taken;
    ++steps_;
    if (taken == h) return;
    friction_.stop(xdot.data());
    choose_sticking();
  }

  /// Of the step of length h, which is in next_x_ and next_xdot_: how far it goes before a joint
  /// begins to stick or to slide. Shortens it to that, or rather to the first instant beyond.
  double until_change(double h) {
    if (!friction_.present()) return h;
    const auto violation = [this](double step_s) {
      if (friction_.sticks()) {
        accelerate(now_s + step_s, next_x_.data(), next_xdot_.data(), xddot_.data());
      }
      return friction_.violation(next_xdot_.data());
    };
    double high = violation(h);
    if (!(high > 0)) return h;
    // Regula falsi, Illinois variant: an end that stays is counted half.
    double low = 0, low_s = 0, high_s = h;
    bool was_beyond = true;
    for (int k = 0; k < 200 && high_s - low_s > 1e-12 * h; ++k) {
      const double share = low < 0 ? low / (low - high) : 0.5;
      const double middle_s = low_s + share * (high_s - low_s);
      if (!(middle_s > low_s && middle_s < high_s)) break;
      evaluate(middle_s);
      const double middle = violation(middle_s);
      const bool beyond = middle > 0;
      if (beyond == was_beyond) (beyond ? low : high) /= 2;
      (beyond ? high : low) = middle;
      (beyond ? high_s : low_s) = middle_s;
      was_beyond = beyond;
    }
    evaluate(high_s);
    return high_s;
  }

  /// The step of length h, into next_x_ and next_xdot_.
  /// @return the largest estimated error, of each value relative to the larger of it and 1.
  double evaluate(double h) {
    for (std::size_t i = 0; i < method_.stages; ++i) {
      const auto& a = method_.a[i];
      double time_s = now_s;
      next_x_ = x;
      next_xdot_ = xdot;
      for (std::size_t j = 0; j < i; ++j) {
        const double weight = h * a[j];
        time_s += weight;
        if (weight == 0) continue;
        next_x_ += weight * rate_[j];
        next_xdot_ += weight * acceleration_[j];
      }
      rate_[i] = next_xdot_;
      accelerate(time_s, next_x_.data(), next_xdot_.data(), acceleration_[i].data());
    }
    next_x_ = x;
    next_xdot_ = xdot;
    error_x_.setZero(x.size());
    error_xdot_.setZero(x.size());
    for (std::size_t i = 0; i < method_.stages; ++i) {
      next_x_ += (h * method_.b[i]) * rate_[i];
      next_xdot_ += (h * method_.b[i]) * acceleration_[i];
      error_x_ += (h * method_.e[i]) * rate_[i];
      error_xdot_ += (h * method_.e[i]) * acceleration_[i];
    }
    double largest = 0;
    for (Eigen::Index i = 0; i < x.size(); ++i) {
      const double of_x = std::abs(error_x_[i]) / std::max(1.0, std::abs(x[i]));
      const double of_xdot = std::abs(error_xdot_[i]) / std::max(1.0, std::abs(xdot[i]));
      if (!(of_x <= largest)) largest = of_x;
      if (!(of_xdot <= largest)) largest = of_xdot;
    }
    return largest;
  }

  static constexpr double max_growth = 5;

  robot::EquationsOfMotion equations_;
  robot::Vector position_, velocity_;
  DryFriction friction_;
  const Tableau& method_;
  double accuracy_;
  Coordinates xddot_;
  std::array<Coordinates, max_stages> rate_, acceleration_;
  Coordinates next_x_, next_xdot_, error_x_, error_xdot_;
  double step_s_ = 0;  ///< the length that the next step is tried with
  std::int64_t steps_ = 0;
};

}  // namespace

std::unique_ptr<ArmMechanics> native_arm(const robot::Model& model, const ArmOptions& options,
                                         const ArmState& initial) {
  return std::make_unique<NativeArm>(model, options, initial);
}

}  // namespace tachless::plant
