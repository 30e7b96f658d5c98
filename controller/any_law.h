#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <utility>

#include "controller/law/law.h"

/// A law together with its memory behind one interface per measurement type, so that whatever
/// steps laws is compiled once per measurement type and not once per law. Which tick is due it is
/// told (`LawStepper` knows); knows no bus.
namespace tachless::controller {

template <class Measurement>
class AnyLaw {
 public:
  /// Of the last step; valid until the next one.
  struct Output {
    const loop::TorqueCommand& command;
    const loop::LawSignals& signals;
  };

  AnyLaw() = default;
  AnyLaw(const AnyLaw&) = delete;
  AnyLaw& operator=(const AnyLaw&) = delete;
  virtual ~AnyLaw() = default;

  [[nodiscard]] virtual std::string_view name() const = 0;
  /// What it logs, in the rows of `Output::signals`.
  [[nodiscard]] virtual std::span<const loop::Signal> signals() const = 0;

  /// The first step, from the memory that the law starts with; at `tick`, as every later one.
  virtual Output start(std::int64_t tick, const Measurement& measurement,
                       const loop::ReferencePoint& reference) = 0;

  /// The step `ticks` periods after the one that was kept last; its memory is not changed before
  /// `keep`, so a step may be discarded. Precondition: one has been kept.
  virtual Output step(std::int64_t tick, const Measurement& measurement,
                      const loop::ReferencePoint& reference, int ticks) = 0;

  /// The memory becomes that after the last `start` or `step`.
  virtual void keep() = 0;
};

/// A law of C++ as an AnyLaw.
template <law::Law L>
class LawWithMemory final : public AnyLaw<typename L::Measurement> {
 public:
  using Measurement = typename L::Measurement;
  using Output = typename AnyLaw<Measurement>::Output;

  explicit LawWithMemory(L law) : law_(std::move(law)) {}

  [[nodiscard]] std::string_view name() const override { return L::name; }
  [[nodiscard]] std::span<const loop::Signal> signals() const override { return L::signals; }

  Output start(std::int64_t /*tick*/, const Measurement& measurement,
               const loop::ReferencePoint& reference) override {
    last_ = law_.step(law_.start(measurement, reference), measurement, reference);
    return {last_.command, last_.signals};
  }

  Output step(std::int64_t /*tick*/, const Measurement& measurement,
              const loop::ReferencePoint& reference, int ticks) override {
    last_ = law_.step(memory_, measurement, reference, ticks);
    return {last_.command, last_.signals};
  }

  void keep() override { memory_ = last_.memory; }

 private:
  L law_;
  law::Step<typename L::Memory> last_;
  typename L::Memory memory_;
};

}  // namespace tachless::controller
