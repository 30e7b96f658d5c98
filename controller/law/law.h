#pragma once

#include <concepts>
#include <span>
#include <string_view>

#include "controller/law/memory.h"
#include "loop/signals.h"
#include "schema/schema.h"

/// What a control law is. A law includes robot/ and the signals of the loop and nothing else; it
/// knows no ticks, messages or scenarios.
namespace tachless::controller::law {

/// What one step of a law returns: its next memory, its command, and what it wants logged.
template <class Memory>
struct Step {
  Memory memory;
  loop::TorqueCommand command;
  loop::LawSignals signals;
};

/// What a law declares of itself, beside its equations: name, parameters (`Gains::keys`), logged
/// signals, and in words its source, what is proved of it and under which conditions.
template <class L>
concept Declared = schema::has_keys<typename L::Gains> && requires {
  { L::name } -> std::convertible_to<std::string_view>;
  { std::span(L::signals) } -> std::convertible_to<std::span<const loop::Signal>>;
  { L::source } -> std::convertible_to<std::string_view>;
  { L::proved } -> std::convertible_to<std::string_view>;
  { L::conditions } -> std::convertible_to<std::string_view>;
  { L::regulation_only } -> std::convertible_to<bool>;  ///< the reference must be constant
  { L::has_feedforward_lead } -> std::convertible_to<bool>;
};

/// A law is a value: parameters and model are constants, its memory is a value that the caller
/// keeps. `start` gives the memory before the first step from the first measurement; `step` is then
/// called once per tick, the first included. `ticks`: sampling periods since the step that gave
/// `memory`; more than one after measurements were lost.
template <class L>
concept Law = Declared<L> && DeclaredMemory<typename L::Memory> &&
    requires(const L& law, const typename L::Memory& memory,
             const typename L::Measurement& measurement, const loop::ReferencePoint& reference,
             int ticks) {
  { law.start(measurement, reference) } -> std::same_as<typename L::Memory>;
  { law.step(memory, measurement, reference) } -> std::same_as<Step<typename L::Memory>>;
  { law.step(memory, measurement, reference, ticks) } -> std::same_as<Step<typename L::Memory>>;
};

/// Lock on velocity: the measurement is exactly a type that holds positions and nothing else.
template <class Measurement>
concept PositionOnly = std::same_as<Measurement, loop::PositionMeasurement> ||
    std::same_as<Measurement, loop::MotorPositionMeasurement>;

template <class L>
concept OutputFeedbackLaw = Law<L> && PositionOnly<typename L::Measurement>;

}  // namespace tachless::controller::law
