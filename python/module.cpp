#include <fmt/format.h>
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include "base/text.h"
#include "base/version.h"
#include "controller/program.h"
#include "in_process/in_process_loop.h"
#include "logger/log_file.h"
#include "logger/table.h"
#include "own_loop/own_loop.h"
#include "plant/truth_of.h"
#include "python/python_law.h"
#include "robot/dynamics.h"
#include "robot/kinematics.h"
#include "scenario/scenario.h"

/// The compiled part of the Python package: a robot's mechanics, runs as arrays, simulation and the
/// controller's program. The other part of the package is tachless/__init__.py.
namespace tachless::python {
namespace {

using base::Failure;
using py::literals::operator""_a;
using robot::Model;

Model read_robot(const std::filesystem::path& urdf, const std::vector<std::string>& overrides,
                 double gravity) {
  const scenario::RobotFile file = scenario::robot_file(urdf, overrides);
  if (urdf.extension() == ".yaml" || urdf.extension() == ".yml") {
    throw base::bad_usage("{}: a scenario; give the file of its robot.urdf", urdf.string());
  }
  try {
    Model model = robot::model_from_urdf(file.urdf, urdf.string(), file.options);
    if (!std::isfinite(gravity)) {
      throw base::bad_usage("gravity: {}; allowed: a finite number [m/s²]", gravity);
    }
    model.gravity = model.gravity.normalized() * gravity;
    return model;
  } catch (const std::invalid_argument& problem) {
    throw base::bad_usage(problem.what());
  }
}

py::array_t<double> forward(const Model& model, const Vector& q, const Vector& v,
                            const Vector& tau) {
  try {
    return array_of(robot::forward_dynamics(model, q, v, tau));
  } catch (const std::logic_error& problem) {
    throw base::bad_usage(problem.what());
  }
}

std::vector<std::string> links(const Model& model) {
  std::vector<std::string> all;
  for (const auto& [name, frame] : model.frames) all.push_back(name);
  return all;
}

Eigen::Matrix4d pose(const Model& model, const std::string& link, const Vector& q) {
  const auto X = robot::frame_pose(model, link, q);
  Eigen::Matrix4d result = Eigen::Matrix4d::Identity();
  result.topLeftCorner<3, 3>() = X.R;
  result.topRightCorner<3, 1>() = X.p;
  return result;
}

void declare_robot(py::module_& module) {
  const auto limits = [](const auto member) {
    return [member](const Model& robot) { return array_of(robot.*member); };
  };
  const auto vector = [](const Model& robot, const py::handle& object, const char* name) {
    return vector_of(object, robot.num_joints, name);
  };
  using Robot = const Model&;
  using Given = const py::handle&;  // n numbers
  declare_class<Model>(module, "Robot")
      .def(py::init(&read_robot))
      .def_readonly("num_joints", &Model::num_joints, "n.")
      .def_readonly("joints", &Model::joint_names, "Names of the joints, in the order of q.")
      .def_property_readonly("links", &links, "Names of the links, for pose().")
      .def_readonly("warnings", &Model::warnings, "What was read with a doubt.")
      .def_property_readonly("lower", limits(&Model::lower),
                             "Lower limits of q, rad or m; -inf: none.")
      .def_property_readonly("upper", limits(&Model::upper),
                             "Upper limits of q, rad or m; inf: none.")
      .def_property_readonly("effort_limit", limits(&Model::effort_limit), "N m or N; inf: none.")
      .def_property_readonly("velocity_limit", limits(&Model::velocity_limit),
                             "rad/s or m/s; inf: none.")
      .def(
          "M",
          [=](Robot robot, Given q) -> Eigen::MatrixXd {
            return robot::mass_matrix<double>(robot, vector(robot, q, "q"));
          },
          "q"_a,
          "Inertia matrix (n, n), kg m²; with the armature of an MJCF, without other rotors.")
      .def(
          "C",
          [=](Robot robot, Given q, Given v) -> Eigen::MatrixXd {
            return robot::coriolis_matrix(robot, vector(robot, q, "q"), vector(robot, v, "v"));
          },
          "q"_a, "v"_a,
          "Coriolis matrix (n, n) of Christoffel's symbols: Mdot - 2 C is skew-symmetric.")
      .def(
          "g",
          [=](Robot robot, Given q) {
            return array_of(robot::gravity_torque(robot, vector(robot, q, "q")));
          },
          "q"_a, "Torque (n,) that holds the robot still against gravity.")
      .def(
          "ID",
          [=](Robot robot, Given q, Given v, Given a) {
            return array_of(robot::inverse_dynamics<double>(
                robot, vector(robot, q, "q"), vector(robot, v, "v"), vector(robot, a, "a")));
          },
          "q"_a, "v"_a, "a"_a, "Inverse dynamics: M(q) a + C(q, v) v + g(q), (n,).")
      .def(
          "FD",
          [=](Robot robot, Given q, Given v, Given tau) {
            return forward(robot, vector(robot, q, "q"), vector(robot, v, "v"),
                           vector(robot, tau, "tau"));
          },
          "q"_a, "v"_a, "tau"_a, "Forward dynamics: the acceleration (n,) under the torque tau.")
      .def(
          "pose",
          [=](Robot robot, const std::string& link, Given q) {
            if (robot.frames.count(link) == 0) {
              throw base::bad_usage("link: \"{}\"; this robot has {}", link,
                                    base::joined(links(robot)));
            }
            return pose(robot, link, vector(robot, q, "q"));
          },
          "link"_a, "q"_a, "The link's frame in the root link's, as a homogeneous matrix (4, 4).");
}

/// A run as arrays, simulated or read from a log.
struct Run {
  struct Column {
    logger::Quantity quantity;
    std::vector<double> values;
    bool any = false;
  };

  Run(const scenario::Scenario& described, const messages::LawInfo& by)
      : scenario(described.name),
        law(described.controller.law_text()),
        text(described.text),
        period_s(described.loop.period_s),
        joints(described.model->joint_names) {
    for (logger::Quantity& quantity : logger::quantities_of(described, by)) {
      columns.push_back({std::move(quantity), {}, false});
    }
  }

  /// Adds one tick. Quantities that the record lacks are NaN.
  void add(const messages::TickRecord& record) {
    ticks.push_back(record.tick);
    for (Column& column : columns) {
      const std::size_t begin = column.values.size();
      column.values.resize(begin + column.quantity.units.size(),
                           std::numeric_limits<double>::quiet_NaN());
      if (!messages::has(record, column.quantity.slot)) continue;
      column.quantity.read(record, column.values.data() + begin);
      column.any = true;
    }
  }
  /// Removes the quantities that no record had. It must be called last.
  void finish() {
    std::erase_if(columns, [](const Column& column) { return !column.any; });
  }

  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> all;
    for (const Column& column : columns) all.push_back(column.quantity.name);
    return all;
  }
  /// Returns the column of that name.
  /// @throw py::key_error, naming the columns that exist
  [[nodiscard]] const Column& column(const std::string& name) const {
    for (const Column& column : columns) {
      if (column.quantity.name == name) return column;
    }
    throw py::key_error(fmt::format("{}: this run has {}", name, base::joined(names())));
  }

  std::string scenario, law, text;
  std::int64_t run = 0;
  double period_s;
  std::vector<std::string> joints;
  std::vector<Column> columns;
  std::vector<std::int64_t> ticks;
};

py::array_t<double> array(const Run& run, const std::string& name) {
  const auto& [quantity, values, any] = run.column(name);
  std::vector<std::size_t> shape = {run.ticks.size()};
  if (!quantity.joints.empty()) shape.push_back(quantity.units.size());
  return py::array_t<double>(shape, values.data());
}

py::array_t<double> times(const Run& run) {
  py::array_t<double> t(static_cast<py::ssize_t>(run.ticks.size()));
  std::transform(run.ticks.begin(), run.ticks.end(), t.mutable_data(),
                 [&](std::int64_t tick) { return static_cast<double>(tick) * run.period_s; });
  return t;
}

/// Reads a run from a log.
/// @param path a log, or a run's directory
Run read(const std::filesystem::path& path, std::int64_t id) {
  const py::gil_scoped_release unlocked;
  logger::RunLog log =
      logger::RunLog::open(logger::find_log(path), id == 0 ? std::nullopt : std::optional(id));
  Run run(log.scenario(), log.info());
  run.run = log.run();
  messages::TickRecord record;
  while (log.next(record)) run.add(record);
  run.finish();
  return run;
}

/// Simulates the loop of a scenario.
/// @param f a Python callable as the law in place of the scenario's; None: the scenario's law
Run simulate(const std::filesystem::path& path, const std::vector<std::string>& overrides,
             const py::object& f, const std::string& name) {
  const bool own = !f.is_none();
  scenario::Scenario scenario = scenario::load_scenario(path, overrides);
  if (own && scenario.controller.law != controller::external_law_name) {
    scenario.controller.measurement = controller::law_facts(scenario.controller.law).measurement;
    scenario.controller.law = controller::external_law_name;
  }
  controller::ScenarioLaw law = own ? python_law(scenario, f, name, Interrupt::passed_on)
                                    : controller::scenario_law(scenario);
  if (own) scenario.controller.announced = law->name();
  const py::gil_scoped_release unlocked;
  Run run(scenario, controller::law_info(*law));
  in_process::run_in_process(scenario, std::move(law), [&](const in_process::TickRecord& tick) {
    if (tick.tick % 1000 == 0) {  // checks for Ctrl-C; seldom, because it waits for the lock
      const py::gil_scoped_acquire locked;
      if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    }
    messages::TickRecord record;
    record.tick = tick.tick;
    record.measurement = tick.measurement;
    record.reference = tick.reference;
    record.command = tick.command;
    record.controller_state = tick.controller;
    record.truth = plant::truth_of(tick.truth, tick.applied);
    run.add(record);
    return true;
  });
  run.finish();
  return run;
}

void declare_run(py::module_& module) {
  declare_class<Run>(
      module, "Run",
      R"(A run, simulated or recorded: run["q"] is an array (ticks, joints), run.t its times.

A quantity that a tick lacks (lost in realtime) is NaN. names lists the quantities:
true state q, v; reference q_ref, v_ref, ...; tau; the law's signals; what was measured, ..._measured.)")
      .def_property_readonly("names", &Run::names, "The quantities of this run.")
      .def_readonly("joints", &Run::joints, "Names of the joints, in the order of the columns.")
      .def_readonly("scenario", &Run::scenario, "Name of the scenario.")
      .def_readonly("law", &Run::law, "Name of the control law.")
      .def_readonly("text", &Run::text, "The scenario in YAML, with what was set.")
      .def_readonly("run_id", &Run::run, "Number of the run; 0 of a simulated one.")
      .def_readonly("period_s", &Run::period_s, "Length of a tick, s.")
      .def_property_readonly(
          "ticks",
          [](const Run& run) {
            return py::array_t<std::int64_t>(static_cast<py::ssize_t>(run.ticks.size()),
                                             run.ticks.data());
          },
          "Numbers of the ticks, (ticks,).")
      .def_property_readonly("t", &times, "Times of the ticks, s, (ticks,).")
      .def("__getitem__", &array)
      .def("__iter__", [](const Run& run) { return py::iter(py::cast(run.names())); })
      .def("__len__", [](const Run& run) { return run.names().size(); })
      .def("__contains__",
           [](const Run& run, const py::object& name) {
             return py::cast(run.names()).contains(name);
           })
      .def(
          "units",
          [](const Run& run, const std::string& name) { return run.column(name).quantity.units; },
          "name"_a,
          R"(Unit of each column of run[name], as in exports: "rad", "rad_per_s", "Nm", "1".)")
      .def(
          "description",
          [](const Run& run, const std::string& name) {
            return run.column(name).quantity.description;
          },
          "name"_a, "What run[name] is.")
      .def("__repr__", [](const Run& run) {
        return base::printable(fmt::format("<tachless.Run {}, {}, {} ticks: {}>", run.scenario,
                                           run.law, run.ticks.size(), base::joined(run.names())));
      });
  module.def("read", &read);
  module.def("simulate", &simulate);
}

int run_controller(const std::vector<std::string>& words, const py::object& f,
                   const std::string& name) {
  std::vector<const char*> argv;
  argv.reserve(words.size());
  for (const std::string& word : words) argv.push_back(word.c_str());
  const py::gil_scoped_release unlocked;
  return tachless::run_controller(static_cast<int>(argv.size()), argv.data(),
                                  [&](const scenario::Scenario& scenario) {
                                    const py::gil_scoped_acquire locked;
                                    return python_law(scenario, f, name, Interrupt::a_failure);
                                  });
}

PYBIND11_MODULE(_tachless, module) {
  module.attr("version") = std::string(base::version);
  static const py::exception<Failure> error(module, "Error");
  static const auto set_error = [](const char* what, base::ExitCode code) {
    const py::object made = py::reinterpret_borrow<py::object>(error)(what);
    made.attr("code") = static_cast<int>(code);
    PyErr_SetObject(error.ptr(), made.ptr());
  };
  // NOLINTNEXTLINE(performance-unnecessary-value-param): pybind11 requires this signature
  py::register_exception_translator([](std::exception_ptr raised) {
    try {
      if (raised) std::rethrow_exception(raised);
    } catch (const Failure& failure) {
      set_error(failure.what(), failure.code());
    } catch (const own_loop::NotCertified& refused) {
      set_error(refused.what(), base::ExitCode::check_said_no);
    }
  });
  declare_class<Measurement>(module, "Measurement")
      .def_readonly("q", &Measurement::q)
      .def_readonly("v", &Measurement::v)
      .def_readonly("theta", &Measurement::theta)
      .def_readonly("thetadot", &Measurement::thetadot);
  declare_class<Reference>(module, "Reference")
      .def_readonly("q", &Reference::q)
      .def_readonly("v", &Reference::v)
      .def_readonly("a", &Reference::a)
      .def_readonly("jerk", &Reference::jerk)
      .def_readonly("snap", &Reference::snap);
  declare_robot(module);
  declare_run(module);
  declare_linear(module);
  declare_listener(module);
  declare_own_loop(module);
  module.def("run_controller", &run_controller);
}

}  // namespace
}  // namespace tachless::python
