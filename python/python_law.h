#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstddef>
#include <string>
#include <typeinfo>

#include "controller/registry.h"

/// A control law that is a Python callable, and declarations that the module's sources share.
namespace tachless::python {

namespace py = pybind11;

/// Measurement as copies, which the callable may keep.
struct Measurement {
  py::object q, v, theta, thetadot;  ///< None: not measured
};
/// Reference as copies, position to snap.
struct Reference {
  py::array_t<double> q, v, a, jerk, snap;
};

enum class Interrupt { passed_on, a_failure };

py::array_t<double> array_of(const Vector& x);

/// Returns the vector that a Python object holds.
/// @throw base::Failure naming `what`, the required shape and the given shape
Vector vector_of(const py::handle& object, int size, const std::string& what);

/// Returns a law whose torque is `f(k, t, measurement, reference)`. If `f` has a method `reset`,
/// the law calls `reset` before the first step. After a long gap in realtime the memory has to
/// start again, and the law calls `reset` again. An exception of the callable becomes a
/// base::Failure, except KeyboardInterrupt with `Interrupt::passed_on`. The law logs the position
/// error if it measures the links. Use and destroy the law without the GIL.
/// @param name name that the controller announces
/// @param scenario its controller.measurement determines the measurement of the law
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

/// Declare the parts of the module that have their own source files.
void declare_linear(py::module_& module);
void declare_listener(py::module_& module);
void declare_own_loop(py::module_& module);

}  // namespace tachless::python
