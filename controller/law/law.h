#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <functional>
#include <span>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>

#include "base/quantities.h"
#include "base/schema.h"
#include "controller/law/filter.h"
#include "messages/signals.h"

/// What a control law is and what it declares; what laws are made of is in parts.h. A law includes
/// robot/ and the signals of the loop and nothing else; it knows no ticks, messages or scenarios.
namespace tachless::controller::law {

using messages::ReferencePoint;
using messages::Signal;

/// What one step of a law returns: its next memory, its command, and what it wants logged.
template <class Memory>
struct Step {
  Memory memory;                    ///< for the next step
  messages::TorqueCommand command;  ///< motor torque over the next tick [N m; N]
  messages::LawSignals signals;     ///< as `L::signals` names them; for the log
};

/// What does not belong to one law: sampling. Parameters are a law's own.
struct Settings {
  double period_s = 1e-3;                                    ///< h [s]
  Discretisation filter = Discretisation::first_order_hold;  ///< of the law's filters
  FilterStart filter_start = FilterStart::at_error;          ///< their state before the first tick
  double feedforward_lead_s = 0;  ///< how far ahead the feed-forward is evaluated [s]
  /// Standard deviation of a measured position as the encoder's data sheet has it [rad]; zero or
  /// empty: ideal.
  Vector position_std{};
  Vector viscous{};  ///< friction that the law feeds forward [N m s/rad]; empty: none
  /// Ticks from the state that was measured to the one over which the command that answers it acts,
  /// the encoder's latency included; at most most_delay.
  int command_delay = 0;

  static constexpr int most_delay = 32;  ///< [ticks]
};

// ---- memory -----------------------------------------------------------------------------------

/// What a law carries from one step to the next, open to whoever has to read and write it number by
/// number (certificate/ linearises laws). A memory that is not empty declares its members:
///
///   struct Memory {
///     Vector nu, e_previous;
///     static constexpr std::tuple members{&Memory::nu, &Memory::e_previous};
///   };
///
/// each a vector, such a memory, or an array of one of them; or, where the step has no useful
/// derivative by its memory, why: `static constexpr std::string_view no_linearisation = "…";`.
template <class T>
inline constexpr bool made_of_vectors = std::is_empty_v<T>;
template <>
inline constexpr bool made_of_vectors<Vector> = true;
template <class T, std::size_t n>
inline constexpr bool made_of_vectors<std::array<T, n>> = made_of_vectors<T>;
template <class T>
requires requires { T::members; }
inline constexpr bool made_of_vectors<T> = std::apply(
    []<class... Member>(Member T::*... /*member*/) {
      return (made_of_vectors<Member> && ...) &&
             (sizeof(Member) + ...) == sizeof(T);  // none is forgotten
    },
    T::members);

/// All numbers of the memory are in vectors that `for_each_vector` finds.
template <class Memory>
concept MadeOfVectors = made_of_vectors<Memory>;

template <class Memory>
concept DeclaredMemory = MadeOfVectors<Memory>
!= requires {
  { Memory::no_linearisation } -> std::convertible_to<std::string_view>;
};

/// f(vector) for each vector of a memory, always in the same order. Which of them are empty is the
/// law's business.
template <class Memory, class F>
requires MadeOfVectors<std::remove_const_t<Memory>>
void for_each_vector(Memory& memory, const F& f) {
  if constexpr (std::same_as<std::remove_const_t<Memory>, Vector>) {
    f(memory);
  } else if constexpr (requires { Memory::members; }) {
    std::apply([&](auto... member) { (for_each_vector(memory.*member, f), ...); }, Memory::members);
  } else if constexpr (!std::is_empty_v<Memory>) {
    for (auto& each : memory) for_each_vector(each, f);
  }
}

// ---- a law ------------------------------------------------------------------------------------

/// What a law declares of itself, beside its equations: name, parameters (`Gains::keys`), logged
/// signals, and in words its source, what is proved of it and under which conditions.
template <class L>
concept Declared = base::has_keys<typename L::Gains> && requires {
  { L::name } -> std::convertible_to<std::string_view>;
  { std::span(L::signals) } -> std::convertible_to<std::span<const Signal>>;
  { L::source } -> std::convertible_to<std::string_view>;
  { L::proved } -> std::convertible_to<std::string_view>;
  { L::conditions } -> std::convertible_to<std::string_view>;
  { L::regulation_only } -> std::convertible_to<bool>;  ///< the reference must be constant
  { L::has_feedforward_lead } -> std::convertible_to<bool>;
};

/// A law is a value: parameters and model are constants, its memory is a value that the caller
/// keeps. `start` gives the memory before the first step from the first measurement; `step` is then
/// called once per period, the first included; of periods whose measurement was lost the caller
/// interpolates one (`AnyLaw`).
template <class L>
concept Law = Declared<L> && DeclaredMemory<typename L::Memory> &&
    requires(const L& law, const typename L::Memory& memory,
             const typename L::Measurement& measurement, const ReferencePoint& reference) {
  { law.start(measurement, reference) } -> std::same_as<typename L::Memory>;
  { law.step(memory, measurement, reference) } -> std::same_as<Step<typename L::Memory>>;
};

/// Lock on velocity: the measurement is exactly a type that holds positions and nothing else.
template <class Measurement>
concept PositionOnly = std::same_as<Measurement, messages::PositionMeasurement> ||
    std::same_as<Measurement, messages::MotorPositionMeasurement>;

template <class L>
concept OutputFeedbackLaw = Law<L> && PositionOnly<typename L::Measurement>;

// ---- what a law may declare besides -----------------------------------------------------------

/// From what a law's rule of thumb for its gains starts: two poles at the bandwidth w for each
/// joint taken alone. A law that has one declares `static Gains tuned(const Tuning&)`. The rule
/// looks at no margin: `design` does (analysis/design/design.h).
struct Tuning {
  double w = 0;            ///< bandwidth [rad/s]
  double damping = 1;      ///< of the two poles
  double filter = 0;       ///< pole of filters and observers [1/s]
  double period_s = 1e-3;  ///< h [s]
  Vector inertia;          ///< what each joint feels [kg m2]
  Vector stiffness;        ///< K [N m/rad]; empty for rigid joints
  Vector rotor;            ///< J [kg m2]; empty for rigid joints

  /// w^2 inertia [N m/rad].
  [[nodiscard]] Vector kp() const { return w * w * inertia; }
  /// 2 damping w inertia [N m s/rad].
  [[nodiscard]] Vector kd() const { return 2 * (damping * w) * inertia; }
  /// Gains of a motor's position and velocity that move its link through the spring: links and
  /// rotors as one, no faster than a quarter of the link's resonance on its spring.
  [[nodiscard]] std::pair<Vector, Vector> through_spring() const {
    const Vector felt = inertia + rotor;
    const Vector slower = (0.25 * stiffness.cwiseQuotient(inertia).cwiseSqrt()).cwiseMin(w);
    return {slower.cwiseAbs2().cwiseProduct(felt), 2 * damping * slower.cwiseProduct(felt)};
  }
  /// The value for each joint.
  [[nodiscard]] Vector each(double value) const { return value * Vector::Ones(inertia.size()); }
  /// Of the motors behind their springs, links held: sqrt(K / J) [rad/s].
  [[nodiscard]] Vector resonance() const { return stiffness.cwiseQuotient(rotor).cwiseSqrt(); }
  /// Damps the resonance by a quarter of critical [N m s/rad].
  [[nodiscard]] Vector motor_kd() const { return 0.5 * rotor.cwiseProduct(resonance()); }
};

template <class L>
concept Tuned = requires(const Tuning& tuning) {
  { L::tuned(tuning) } -> std::same_as<typename L::Gains>;
};

/// Any law as a function of its memory and measurement, both written as vectors: (memory,
/// measurement) -> (next memory, torque); the reference is held fixed inside.
using LawStep = std::function<std::pair<Eigen::VectorXd, Eigen::VectorXd>(const Eigen::VectorXd&,
                                                                          const Eigen::VectorXd&)>;

/// The whole state of a closed loop at one instant.
struct LoopState {
  Vector q;                         ///< links [rad; m]
  Vector v;                         ///< [rad/s; m/s]
  Vector theta;                     ///< motors [rad]; empty on a rigid robot
  Vector thetadot;                  ///< [rad/s]; likewise
  messages::LawSignals controller;  ///< what the law logged for the same tick
};

/// The weights of the cross terms of V, (eps_1 e - eps_2 nu)' M edot: diagonal matrices, by their
/// diagonals, one number of each where it is common to all errors. The paper's V (eq. 15) has one
/// weight: eps_1 and eps_2 both epsilon.
struct LyapunovWeights {
  Eigen::VectorXd eps_1;  ///< [1/s]
  Eigen::VectorXd eps_2;  ///< [1]

  LyapunovWeights() : LyapunovWeights(0, 0) {}
  /// One number of each, for all errors.
  LyapunovWeights(double first, double second)
      : LyapunovWeights(Eigen::VectorXd::Constant(1, first), Eigen::VectorXd::Constant(1, second)) {
  }
  /// By their diagonals.
  LyapunovWeights(Eigen::VectorXd first, Eigen::VectorXd second)
      : eps_1(std::move(first)), eps_2(std::move(second)) {}

  /// Those of `count` errors from `begin` on.
  [[nodiscard]] LyapunovWeights of(Eigen::Index count, Eigen::Index begin = 0) const {
    const auto part = [&](const Eigen::VectorXd& eps) -> Eigen::VectorXd {
      if (eps.size() == 1) return Eigen::VectorXd::Constant(count, eps[0]);
      return eps.segment(begin, count);
    };
    return {part(eps_1), part(eps_2)};
  }
};

/// A law with the Lyapunov function by which its stability is proved: its formula for people, and
/// its value [J]; a function without cross terms ignores the weights. It is a function of the true
/// state, which no law's `step` is given: controller/stepped_law.h evaluates it afterwards.
template <class L>
concept HasLyapunovFunction = requires(const L& law, const LoopState& state,
                                       const ReferencePoint& reference,
                                       const LyapunovWeights& weights) {
  { L::lyapunov_formula } -> std::convertible_to<std::string_view>;
  { law.lyapunov(state, reference, weights) } -> std::same_as<double>;
};

}  // namespace tachless::controller::law
