#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/failure.h"
#include "own_loop/own_loop.h"
#include "python/python_law.h"

namespace tachless::python {
namespace {

using own_loop::CertifiedLoop;
using own_loop::Numbers;

using own_loop::ReferenceBounds;
using own_loop::Step;
using py::literals::operator""_a;

using Array = py::array_t<double, py::array::c_style>;

/// Numbers of a Python object: those of an array of doubles in place, others copied.
class Given {
 public:
  /// @throw base::Failure naming `what`, the required shape and the given shape
  Given(const py::handle& object, int size, const char* what) {
    if (py::isinstance<Array>(object)) {
      const auto array = py::reinterpret_borrow<Array>(object);
      if (array.ndim() == 1 && array.shape(0) == size) {
        view_ = {array.data(), static_cast<std::size_t>(size)};
        return;
      }
    }
    copy_ = vector_of(object, size, what);
    view_ = copy_;
  }
  Given(const Given&) = delete;
  Given& operator=(const Given&) = delete;
  operator Numbers() const { return view_; }  // NOLINT(google-explicit-constructor)

 private:
  Vector copy_;
  Numbers view_;
};

py::array_t<double> array_from(const Numbers& numbers) {
  py::array_t<double> result(static_cast<py::ssize_t>(numbers.size()));
  std::copy(numbers.begin(), numbers.end(), result.mutable_data());
  return result;
}

/// A certified loop that counts its ticks.
class Law {
 public:
  Law(const std::filesystem::path& scenario, const std::optional<ReferenceBounds>& bounds,
      const std::vector<std::string>& set)
      : loop_(bounds ? CertifiedLoop(scenario.string(), *bounds, set)
                     : CertifiedLoop(scenario.string(), set)) {}

  py::array_t<double> step(const py::handle& q, const py::object& reference,
                           std::optional<std::int64_t> tick) {
    const int n = static_cast<int>(loop_.joints().size());
    const std::int64_t now = tick.value_or(next_);
    const Step done =
        reference.is_none() ? loop_.torque(now, Given(q, n, "q")) : follow(now, q, reference, n);
    if (done.has_torque()) next_ = now + 1;
    if (!done.ok()) throw base::Failure(base::ExitCode::protective_stop, loop_.reason(done));
    return array_from(done.tau);
  }
  void reset() {
    loop_.reset();
    next_ = 0;
  }
  [[nodiscard]] py::object planned(std::int64_t tick) {
    const own_loop::Reference reference = loop_.planned(tick);
    if (reference.position.size() == 0) return py::none();
    return py::make_tuple(array_from(reference.position), array_from(reference.velocity),
                          array_from(reference.acceleration));
  }
  [[nodiscard]] const CertifiedLoop& loop() const { return loop_; }
  [[nodiscard]] std::int64_t next() const { return next_; }

 private:
  /// @param reference (q, v, a), or with jerk and snap behind them
  Step follow(std::int64_t tick, const py::handle& q, const py::object& reference, int n) {
    if (!py::isinstance<py::sequence>(reference) || py::len(reference) < 3 ||
        py::len(reference) > 5) {
      throw base::bad_usage("reference is {}; needed: (q, v, a), or with jerk and snap too",
                            std::string(py::str(py::repr(reference))));
    }
    const auto all = py::reinterpret_borrow<py::sequence>(reference);
    const py::object position = all[0], velocity = all[1], acceleration = all[2];
    const Given q_ref(position, n, "reference q"), v_ref(velocity, n, "reference v"),
        a_ref(acceleration, n, "reference a");
    own_loop::Reference given{q_ref, v_ref, a_ref};
    std::optional<Given> jerk, snap;
    if (all.size() > 3) given.jerk = jerk.emplace(py::object(all[3]), n, "reference jerk");
    if (all.size() > 4) given.snap = snap.emplace(py::object(all[4]), n, "reference snap");
    return loop_.torque(tick, Given(q, n, "q"), given);
  }

  CertifiedLoop loop_;
  std::int64_t next_ = 0;  ///< tick of the next step
};

}  // namespace

void declare_own_loop(py::module_& module) {
  declare_class<Law>(module, "Law")
      .def(py::init([](const std::filesystem::path& scenario,
                       const std::optional<std::vector<std::vector<double>>>& bounds,
                       const std::vector<std::string>& set) {
        const py::gil_scoped_release unlocked;
        std::optional<ReferenceBounds> declared;
        if (bounds) declared = {bounds->at(0), bounds->at(1), bounds->at(2), bounds->at(3)};
        return std::make_unique<Law>(scenario, declared, set);
      }))
      .def("step", &Law::step, "q"_a, "reference"_a = py::none(), py::kw_only(),
           "tick"_a = py::none(),
           R"(Returns the torque (n,) to send for the positions q (n,), N m (N on prismatic joints).

Args:
    q: measured positions, rad or m, as the arm reads them.
    reference: (q, v, a) of your own, (n,) each, perhaps with jerk and snap behind them; default: the scenario's.
    tick: number of the tick; default: the next one. A missed reading leaves its tick out.

Raises:
    Error: the reference is beyond its bounds, a number is not finite, or the tick is not later than the last one
        (code 5). There is no torque then: brake.)")
      .def("reset", &Law::reset,
           "Begins a new run: the law's memory begins anew, and the ticks at 0.")
      .def("planned", &Law::planned, "tick"_a,
           "Returns (q, v, a) of the scenario's reference at a tick; None without a reference.")
      .def_property_readonly(
          "certificate", [](const Law& law) { return law.loop().certificate().text; },
          "What is certified, in one line.")
      .def_property_readonly(
          "limit_s", [](const Law& law) { return law.loop().certificate().limit_s; },
          "Largest stable period, s.")
      .def_property_readonly(
          "period_s", [](const Law& law) { return law.loop().period_s(); }, "Period of a tick, s.")
      .def_property_readonly(
          "joints", [](const Law& law) { return law.loop().joints(); },
          "Names of the joints, in the order of q.")
      .def_property_readonly("tick", &Law::next, "Number of the next tick.");
}

}  // namespace tachless::python
