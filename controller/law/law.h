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

/// The concept of a control law and the declarations of a law; the parts of laws are in parts.h. A
/// law includes only robot/ and the signals of the loop. It knows no ticks, messages or scenarios.
namespace tachless::controller::law {

using messages::ReferencePoint;
using messages::Signal;

/// Result of one step of a law: the next memory, the command and the logged signals.
template <class Memory>
struct Step {
  Memory memory;                    ///< memory for the next step
  messages::TorqueCommand command;  ///< motor torque over the next tick [N m; N]
  messages::LawSignals signals;     ///< signals for the log, in the order of `L::signals`
};

/// Settings that all laws share; the parameters of a law are in its `Gains`.
struct Settings {
  double period_s = 1e-3;  ///< h [s]
  /// Discretisation of the law's filters.
  Discretisation filter = Discretisation::first_order_hold;
  FilterStart filter_start = FilterStart::at_error;  ///< initial state of the filters
  double feedforward_lead_s = 0;  ///< how far ahead the feed-forward is evaluated [s]
  /// Standard deviation of a measured position by the encoder's data sheet [rad]; zero or empty:
  /// ideal.
  Vector position_std{};
  /// Friction that is fed forward: by the law if it declares `feeds_friction`, else beside the law
  /// (controller/any_law.h).
  FrictionSpec friction{};
  /// Largest torque of the drives [N m; N]; empty or infinite: no limit.
  Vector torque_limit{};
  /// Ticks from the measured state to the tick over which the answering command acts, at most
  /// most_delay. The encoder's latency is included.
  int command_delay = 0;

  static constexpr int most_delay = 32;  ///< [ticks]
};

// ---- memory -----------------------------------------------------------------------------------

/// True for a memory whose numbers can all be read and written one by one. A law's memory is its
/// state from one step to the next; analysis/linear differentiates the step by it. A memory that is
/// not empty declares its members:
///
///   struct Memory {
///     Vector nu, e_previous;
///     static constexpr std::tuple members{&Memory::nu, &Memory::e_previous};
///   };
///
/// Each member is a vector, such a memory, or an array of one of them. A memory by which the step
/// has no useful derivative declares the reason instead: `static constexpr std::string_view
/// no_linearisation = "…";`.
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

/// A memory whose numbers are all in vectors that `for_each_vector` finds.
template <class Memory>
concept MadeOfVectors = made_of_vectors<Memory>;

/// A memory that declares why the step has no useful derivative.
template <class Memory>
concept MemoryWithoutDerivative = requires {
  { Memory::no_linearisation } -> std::convertible_to<std::string_view>;
};

/// A memory with exactly one of these two properties.
template <class Memory>
concept DeclaredMemory = (MadeOfVectors<Memory> && !MemoryWithoutDerivative<Memory>) ||
                         (MemoryWithoutDerivative<Memory> && !MadeOfVectors<Memory>);

/// Calls f(vector) for each vector of a memory, always in the same order. The law decides which of
/// the vectors are empty.
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

/// A type with a law's declarations beside its equations: name, parameters (`Gains::keys`) and
/// logged signals. It declares in words its source, the proved stability and the conditions of the
/// proof.
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

/// A law: a value whose parameters and model are constants, and whose memory the caller keeps.
/// `start` returns the memory before the first step from the first measurement. The caller then
/// calls `step` once per period, the first included. For a period without a measurement the caller
/// interpolates one (`AnyLaw`).
template <class L>
concept Law = Declared<L> && DeclaredMemory<typename L::Memory> &&
    requires(const L& law, const typename L::Memory& memory,
             const typename L::Measurement& measurement, const ReferencePoint& reference) {
  { law.start(measurement, reference) } -> std::same_as<typename L::Memory>;
  { law.step(memory, measurement, reference) } -> std::same_as<Step<typename L::Memory>>;
};

/// A measurement without velocity: exactly a type that holds positions and nothing else.
template <class Measurement>
concept PositionOnly = std::same_as<Measurement, messages::PositionMeasurement> ||
    std::same_as<Measurement, messages::MotorPositionMeasurement> ||
    std::same_as<Measurement, messages::BothPositionsMeasurement>;

/// A law that measures positions alone.
template <class L>
concept OutputFeedbackLaw = Law<L> && PositionOnly<typename L::Measurement>;

// ---- optional declarations of a law -----------------------------------------------------------

/// Inputs of a law's rule of thumb for its gains. The rule places two poles at the bandwidth w for
/// each joint taken alone. A law with such a rule declares `static Gains tuned(const Tuning&)`. The
/// rule checks no margin; `design` checks them (analysis/design/design.h).
struct Tuning {
  double w = 0;            ///< bandwidth [rad/s]
  double damping = 1;      ///< damping of the two poles
  double filter = 0;       ///< pole of filters and observers [1/s]
  double period_s = 1e-3;  ///< h [s]
  Vector inertia;          ///< inertia that each joint moves [kg m2]
  Vector stiffness;        ///< K [N m/rad]; empty for rigid joints
  Vector rotor;            ///< J [kg m2]; empty for rigid joints

  /// Returns w^2 inertia [N m/rad].
  [[nodiscard]] Vector kp() const { return w * w * inertia; }
  /// Returns 2 damping w inertia [N m s/rad].
  [[nodiscard]] Vector kd() const { return 2 * (damping * w) * inertia; }
  /// Returns the gains of a motor's position and velocity that move the motor's link through the
  /// spring. Link and rotor count as one inertia. The bandwidth is at most a quarter of the link's
  /// resonance on its spring.
  [[nodiscard]] std::pair<Vector, Vector> through_spring() const {
    const Vector felt = inertia + rotor;
    const Vector slower = (0.25 * stiffness.cwiseQuotient(inertia).cwiseSqrt()).cwiseMin(w);
    return {slower.cwiseAbs2().cwiseProduct(felt), 2 * damping * slower.cwiseProduct(felt)};
  }
  /// Returns a vector with `value` for each joint.
  [[nodiscard]] Vector each(double value) const { return value * Vector::Ones(inertia.size()); }
  /// Returns the resonance sqrt(K / J) of the motors on their springs with the links locked
  /// [rad/s].
  [[nodiscard]] Vector resonance() const { return stiffness.cwiseQuotient(rotor).cwiseSqrt(); }
  /// Returns the motor damping that damps the resonance by a quarter of critical [N m s/rad].
  [[nodiscard]] Vector motor_kd() const { return 0.5 * rotor.cwiseProduct(resonance()); }
};

/// A law that declares a rule of thumb for its gains.
template <class L>
concept Tuned = requires(const Tuning& tuning) {
  { L::tuned(tuning) } -> std::same_as<typename L::Gains>;
};

/// Function of a law's memory and measurement, both as vectors, that returns the next memory and
/// the torque. The reference is fixed inside.
using LawStep = std::function<std::pair<Eigen::VectorXd, Eigen::VectorXd>(const Eigen::VectorXd&,
                                                                          const Eigen::VectorXd&)>;

/// The whole state of a closed loop at one instant.
struct LoopState {
  Vector q;                         ///< links [rad; m]
  Vector v;                         ///< [rad/s; m/s]
  Vector theta;                     ///< motors [rad]; empty on a rigid robot
  Vector thetadot;                  ///< [rad/s]; empty on a rigid robot
  messages::LawSignals controller;  ///< the law's logged signals of the same tick
};

/// Weights of the cross terms of V, (eps_1 e - eps_2 nu)' M edot: the diagonals of diagonal
/// matrices. A single entry holds for all errors. The paper's V (eq. 15) has one weight: eps_1 =
/// eps_2 = epsilon.
struct LyapunovWeights {
  Eigen::VectorXd eps_1;  ///< [1/s]
  Eigen::VectorXd eps_2;  ///< [1]

  LyapunovWeights() : LyapunovWeights(0, 0) {}
  /// Builds weights with one number of each for all errors.
  LyapunovWeights(double first, double second)
      : LyapunovWeights(Eigen::VectorXd::Constant(1, first), Eigen::VectorXd::Constant(1, second)) {
  }
  /// Builds weights from their diagonals.
  LyapunovWeights(Eigen::VectorXd first, Eigen::VectorXd second)
      : eps_1(std::move(first)), eps_2(std::move(second)) {}

  /// Returns the weights of the `count` errors from `begin` on.
  [[nodiscard]] LyapunovWeights of(Eigen::Index count, Eigen::Index begin = 0) const {
    const auto part = [&](const Eigen::VectorXd& eps) -> Eigen::VectorXd {
      if (eps.size() == 1) return Eigen::VectorXd::Constant(count, eps[0]);
      return eps.segment(begin, count);
    };
    return {part(eps_1), part(eps_2)};
  }
};

/// A law that declares the Lyapunov function of its stability proof: its formula as text, and its
/// value [J]. A function without cross terms ignores the weights. The function takes the true
/// state, which `step` does not receive; controller/stepped_law.h evaluates it afterwards.
template <class L>
concept HasLyapunovFunction = requires(const L& law, const LoopState& state,
                                       const ReferencePoint& reference,
                                       const LyapunovWeights& weights) {
  { L::lyapunov_formula } -> std::convertible_to<std::string_view>;
  { law.lyapunov(state, reference, weights) } -> std::same_as<double>;
};

}  // namespace tachless::controller::law
