#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <string>

#include "controller/registry.h"

/// A control law that is a Python callable; what the module's sources share.
namespace tachless::python {

namespace py = pybind11;

/// Copies that the callable is given; it may keep them.
struct Measurement {
  py::object q, v, theta, thetadot;  ///< None: not measured
};
struct Reference {
  py::array_t<double> q, v, a, jerk, snap;
};

enum class Interrupt { passed_on, a_failure };

py::array_t<double> array_of(const Vector& x);

/// @throw base::Failure naming `what`, the shape that is needed and the one that came
Vector vector_of(const py::handle& object, int size, const std::string& what);

/// `f(k, t, measurement, reference) -> torque`. Where it has a method `reset`, that is called
/// before the first step, and whenever the memory has to begin anew (after a long gap in realtime).
/// Turns an exception of the callable into a base::Failure, except KeyboardInterrupt on
/// `Interrupt::passed_on`.
/// Logs the position error where it measures the links. To be used and destroyed without the GIL.
/// @param name as announced; the law measures what the scenario's controller.measurement says
controller::ScenarioLaw python_law(const scenario::Scenario& scenario, const py::object& f,
                                   const std::string& name, Interrupt interrupt);

/// The parts of the module with a source of their own.
void declare_linear(py::module_& module);
void declare_listener(py::module_& module);

}  // namespace tachless::python
