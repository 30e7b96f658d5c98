#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstddef>
#include <string>
#include <typeinfo>

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

/// Declares a class. Python can make objects of it without a value, by `__new__` alone. Each use of
/// such an object raises TypeError: pybind11 would allocate memory for the value and not initialise
/// it.
template <class T>
py::class_<T> declare_class(py::module_& module, const char* name, const char* doc = "") {
  py::class_<T> declared(module, name, doc);
  py::detail::get_type_info(typeid(T))->operator_new = [](std::size_t /*size*/) -> void* {
    throw py::type_error("the object has no value, because its __init__ was not called");
  };
  return declared;
}

/// The parts of the module with a source of their own.
void declare_linear(py::module_& module);
void declare_listener(py::module_& module);

}  // namespace tachless::python
