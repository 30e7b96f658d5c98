#include <fmt/format.h>
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cmath>
#include <stdexcept>

#include "controller/program.h"
#include "diagnostics/file_text.h"
#include "diagnostics/text.h"
#include "diagnostics/version.h"
#include "experiment/scenario.h"
#include "python/python_law.h"
#include "python/recorded.h"
#include "robot/forward_dynamics.h"
#include "robot/inverse_dynamics.h"
#include "robot/kinematics.h"
#include "robot/mass_matrix.h"

/// The compiled half of the Python package; what it says of itself is in tachless/__init__.py.
namespace tachless::python {
namespace {

using diagnostics::Failure;
using robot::Vector;

/// A robot of a URDF.
class Robot {
 public:
  Robot(const std::filesystem::path& urdf, const std::vector<std::string>& overrides) {
    const std::string text = diagnostics::given_text(urdf);
    try {
      model_ = robot::model_from_urdf(text, urdf.string(), experiment::urdf_options(overrides));
    } catch (const std::invalid_argument& problem) {
      throw diagnostics::bad_usage(problem.what());
    }
  }

  [[nodiscard]] const robot::Model& model() const { return model_; }
  void set_gravity(double g) {
    if (!std::isfinite(g)) {
      throw diagnostics::bad_usage("gravity: {}; allowed: a finite number [m/s²]", g);
    }
    model_.gravity = model_.gravity.normalized() * g;
  }

  [[nodiscard]] Eigen::MatrixXd M(const py::handle& q) const {
    return robot::mass_matrix<double>(model_, vector(q, "q"));
  }
  [[nodiscard]] Eigen::MatrixXd C(const py::handle& q, const py::handle& v) const {
    return robot::coriolis_matrix<double>(model_, vector(q, "q"), vector(v, "v"));
  }
  [[nodiscard]] py::array_t<double> g(const py::handle& q) const {
    return array_of(robot::gravity_torque<double>(model_, vector(q, "q")));
  }
  [[nodiscard]] py::array_t<double> ID(const py::handle& q, const py::handle& v,
                                       const py::handle& a) const {
    return array_of(
        robot::inverse_dynamics<double>(model_, vector(q, "q"), vector(v, "v"), vector(a, "a")));
  }
  [[nodiscard]] py::array_t<double> FD(const py::handle& q, const py::handle& v,
                                       const py::handle& tau) const {
    try {
      return array_of(robot::forward_dynamics<double>(model_, vector(q, "q"), vector(v, "v"),
                                                      vector(tau, "tau")));
    } catch (const std::logic_error& problem) {
      throw diagnostics::bad_usage(problem.what());
    }
  }
  [[nodiscard]] Eigen::Matrix4d pose(const std::string& link, const py::handle& q) const {
    if (model_.frames.count(link) == 0) {
      throw diagnostics::bad_usage("link: \"{}\"; this robot has {}", link,
                                   diagnostics::joined(links()));
    }
    const auto X = robot::frame_pose<double>(model_, link, vector(q, "q"));
    Eigen::Matrix4d result = Eigen::Matrix4d::Identity();
    result.topLeftCorner<3, 3>() = X.R;
    result.topRightCorner<3, 1>() = X.p;
    return result;
  }
  [[nodiscard]] std::vector<std::string> links() const {
    std::vector<std::string> all;
    for (const auto& [name, frame] : model_.frames) all.push_back(name);
    return all;
  }

 private:
  [[nodiscard]] Vector vector(const py::handle& object, const char* what) const {
    return vector_of(object, model_.num_joints, what);
  }

  robot::Model model_;
};

void declare_robot(py::module_& module) {
  const auto joints = [](const auto member) {
    return [member](const Robot& robot) { return array_of(robot.model().*member); };
  };
  py::class_<Robot>(module, "Robot")
      .def(py::init<std::filesystem::path, std::vector<std::string>>())
      .def("set_gravity", &Robot::set_gravity)
      .def_property_readonly("num_joints", [](const Robot& of) { return of.model().num_joints; })
      .def_property_readonly("joints", [](const Robot& of) { return of.model().joint_names; })
      .def_property_readonly("links", &Robot::links)
      .def_property_readonly("warnings", [](const Robot& of) { return of.model().warnings; })
      .def_property_readonly("lower", joints(&robot::Model::lower))
      .def_property_readonly("upper", joints(&robot::Model::upper))
      .def_property_readonly("effort_limit", joints(&robot::Model::effort_limit))
      .def_property_readonly("velocity_limit", joints(&robot::Model::velocity_limit))
      .def("M", &Robot::M)
      .def("C", &Robot::C)
      .def("g", &Robot::g)
      .def("ID", &Robot::ID)
      .def("FD", &Robot::FD)
      .def("pose", &Robot::pose);
}

void declare_recorded(py::module_& module) {
  py::class_<Recorded>(module, "Recorded")
      .def_readonly("scenario", &Recorded::scenario)
      .def_readonly("law", &Recorded::law)
      .def_readonly("text", &Recorded::text)
      .def_readonly("run", &Recorded::run)
      .def_readonly("period_s", &Recorded::period_s)
      .def_readonly("joints", &Recorded::joints)
      .def("names", &Recorded::names)
      .def("array", &Recorded::array)
      .def("units", &Recorded::units)
      .def("description", &Recorded::description)
      .def("ticks", &Recorded::ticks)
      .def("time", &Recorded::time);
  module.def("read", &read);
  module.def("simulate", &simulate);
}

int run(const std::vector<std::string>& words, const py::object& f, const std::string& name) {
  std::vector<const char*> argv;
  argv.reserve(words.size());
  for (const std::string& word : words) argv.push_back(word.c_str());
  const py::gil_scoped_release unlocked;
  return run_controller(static_cast<int>(argv.size()), argv.data(),
                        [&](const experiment::Scenario& scenario) {
                          const py::gil_scoped_acquire locked;
                          return python_law(scenario, f, name, Interrupt::a_failure);
                        });
}

PYBIND11_MODULE(_tachless, module) {
  module.attr("version") = std::string(diagnostics::version);
  static const py::exception<Failure> error(module, "Error");
  // NOLINTNEXTLINE(performance-unnecessary-value-param): so pybind11 has it
  py::register_exception_translator([](std::exception_ptr raised) {
    try {
      if (raised) std::rethrow_exception(raised);
    } catch (const Failure& failure) {
      const py::object made = py::reinterpret_borrow<py::object>(error)(failure.what());
      made.attr("code") = static_cast<int>(failure.code());
      PyErr_SetObject(error.ptr(), made.ptr());
    }
  });
  py::class_<Measurement>(module, "Measurement")
      .def_readonly("q", &Measurement::q)
      .def_readonly("v", &Measurement::v)
      .def_readonly("theta", &Measurement::theta)
      .def_readonly("thetadot", &Measurement::thetadot);
  py::class_<Reference>(module, "Reference")
      .def_readonly("q", &Reference::q)
      .def_readonly("v", &Reference::v)
      .def_readonly("a", &Reference::a)
      .def_readonly("jerk", &Reference::jerk)
      .def_readonly("snap", &Reference::snap);
  declare_robot(module);
  declare_recorded(module);
  module.def("run_controller", &run);
}

}  // namespace
}  // namespace tachless::python
