#include "python/python_law.h"

#include <fmt/format.h>

#include <memory>
#include <optional>
#include <string_view>

#include "base/failure.h"
#include "messages/measurements.h"

namespace tachless::python {
namespace {

using base::ExitCode;
using base::Failure;

Measurement measurement_of(const messages::AnyMeasurement& any) {
  const auto or_none = [](const Vector* x) {
    return x == nullptr || x->size() == 0 ? py::object(py::none()) : array_of(*x);
  };
  const auto [q, v, theta, thetadot] = messages::parts_of(any);
  return {or_none(q), or_none(v), or_none(theta), or_none(thetadot)};
}

class PythonLaw final : public controller::AnyLaw {
 public:
  PythonLaw(const scenario::Scenario& scenario, py::object f, std::string name, Interrupt interrupt)
      : AnyLaw(scenario.loop),
        f_(std::move(f)),
        name_(std::move(name)),
        measurement_(scenario.controller.measurement),
        interrupt_(interrupt),
        num_joints_(scenario.num_joints),
        period_s_(scenario.loop.period_s) {
    if (!py::hasattr(f_, "set_gains")) return;
    py::dict gains;
    for (const auto& [gain, value] : scenario.controller.gains) {
      gains[gain.c_str()] = array_of(value);
    }
    in_python({}, [&] { f_.attr("set_gains")(gains); });
  }
  ~PythonLaw() override {
    const py::gil_scoped_acquire locked;
    f_ = py::object();
  }

  [[nodiscard]] std::string_view name() const override { return name_; }
  [[nodiscard]] std::string_view measurement() const override { return measurement_; }
  [[nodiscard]] std::span<const messages::Signal> signals() const override {
    static constexpr std::array logged{messages::Signal{"error", "rad"}};
    bool links = false;
    messages::with_measurement(measurement_, [&]<class M>(std::type_identity<M> /*type*/) {
      links = messages::holds_links<M>;
    });
    return std::span(logged).first(links ? 1 : 0);
  }

 private:
  void compute(std::int64_t tick, const messages::AnyMeasurement& any,
               const messages::ReferencePoint& reference, int ticks) override {
    std::visit(
        [&]<class M>(const M& measurement) {
          for (int i = 1; i < ticks; ++i) {
            const double share = static_cast<double>(i) / ticks;
            call(tick - ticks + i,
                 messages::between(std::get<M>(measurement_of_step_), measurement, share),
                 messages::between(reference_, reference, share));
          }
          call(tick, measurement, reference, ticks == 0);
        },
        any);
    measurement_of_step_ = any;
    reference_ = reference;
    if (const auto* const q = messages::parts_of(any)[0]) {
      signals_of_step_ = {1, {*q - reference.q_ref}};
    }
  }

  void call(std::int64_t tick, const messages::AnyMeasurement& measurement,
            const messages::ReferencePoint& reference, bool anew = false) {
    in_python(tick, [&] {
      if (anew && py::hasattr(f_, "reset")) f_.attr("reset")();
      const py::object tau = f_(
          tick, static_cast<double>(tick) * period_s_, measurement_of(measurement),
          Reference{array_of(reference.q_ref), array_of(reference.v_ref), array_of(reference.a_ref),
                    array_of(reference.jerk_ref), array_of(reference.snap_ref)});
      command_.tau = vector_of(tau, num_joints_, fmt::format("the torque of {}", name_));
    });
  }

  /// Runs `action` under the lock. An exception of `action` ends the run; its traceback goes to
  /// stderr.
  /// @param tick nothing: before the run, in set_gains
  template <class Action>
  void in_python(std::optional<std::int64_t> tick, const Action& action) const {
    const py::gil_scoped_acquire locked;
    const auto where = [&] { return tick ? fmt::format("at tick {}", *tick) : "in set_gains"; };
    try {
      action();
    } catch (const Failure& failure) {
      throw Failure(failure.code(), "{}, {}", failure.what(), where());
    } catch (const py::error_already_set& raised) {
      if (interrupt_ == Interrupt::passed_on && raised.matches(PyExc_KeyboardInterrupt)) throw;
      const std::string what =
          fmt::format("{}: {}", std::string(py::str(raised.type().attr("__name__"))),
                      std::string(py::str(raised.value())));
      // PyErr_Print would end the process at a SystemExit, with the law's exit code.
      const py::object trace = raised.trace() ? raised.trace() : py::object(py::none());
      py::module_::import("traceback")
          .attr("print_exception")(raised.type(), raised.value(), trace);
      throw Failure(tick ? ExitCode::protective_stop : ExitCode::bad_usage,
                    "the law {} raised {}, {}", name_, what, where());
    }
  }

  py::object f_;
  std::string name_, measurement_;
  Interrupt interrupt_;
  int num_joints_;
  double period_s_;
  messages::AnyMeasurement measurement_of_step_;  ///< of the last step, like `reference_`
  messages::ReferencePoint reference_;
};

}  // namespace

py::array_t<double> array_of(const Vector& x) {
  py::array_t<double> result(x.size());
  std::copy(x.begin(), x.end(), result.mutable_data());
  return result;
}

Vector vector_of(const py::handle& object, int size, const std::string& what) {
  // Accepts integers and floating point only. The cast would convert None to NaN and 1j to 0.
  const auto given = py::array::ensure(object);
  if (!given || std::string_view("iuf").find(given.dtype().kind()) == std::string_view::npos) {
    throw base::bad_usage("{} is {}; needed: {} numbers", what,
                          std::string(py::str(py::repr(object))), size);
  }
  const py::array_t<double, py::array::c_style | py::array::forcecast> values(given);
  if (values.ndim() != 1 || values.shape(0) != size) {
    std::vector<py::ssize_t> shape(values.shape(), values.shape() + values.ndim());
    throw base::bad_usage("{} has the shape ({}); needed: ({},)", what, fmt::join(shape, ", "),
                          size);
  }
  Vector result(size);
  std::copy_n(values.data(), size, result.data());
  return result;
}

controller::ScenarioLaw python_law(const scenario::Scenario& scenario, const py::object& f,
                                   const std::string& name, Interrupt interrupt) {
  return std::make_unique<PythonLaw>(scenario, f, name, interrupt);
}

}  // namespace tachless::python
