#include "python/recorded.h"

#include <fmt/format.h>

#include <limits>
#include <optional>

#include "diagnostics/text.h"
#include "plant/run_messages.h"
#include "python/python_law.h"
#include "study/in_process_loop.h"

namespace tachless::python {

Recorded::Recorded(const experiment::Scenario& of, const loop::LawInfo& by)
    : scenario(of.name),
      law(of.controller.law == experiment::external_law
              ? fmt::format("{} ({})", by.name, experiment::external_law)
              : of.controller.law),
      text(of.text),
      period_s(of.loop.period_s),
      joints(of.model->joint_names) {
  for (logger::Quantity& quantity : logger::quantities_of(of, by)) {
    columns_.push_back({std::move(quantity), {}, false});
  }
}

void Recorded::add(const loop::TickRecord& record) {
  ticks_.push_back(record.tick);
  for (Column& column : columns_) {
    const std::size_t size = column.quantity.units.size();
    const std::size_t begin = column.values.size();
    column.values.resize(begin + size, std::numeric_limits<double>::quiet_NaN());
    if (!loop::has(record, column.quantity.slot)) continue;
    column.quantity.read(record, column.values.data() + begin);
    column.any = true;
  }
}

void Recorded::finish() {
  std::erase_if(columns_, [](const Column& column) { return !column.any; });
}

const Recorded::Column& Recorded::column(const std::string& name) const {
  for (const Column& column : columns_) {
    if (column.quantity.name == name) return column;
  }
  throw py::key_error(fmt::format("{}: this run has {}", name, diagnostics::joined(names())));
}

std::vector<std::string> Recorded::names() const {
  std::vector<std::string> all;
  for (const Column& column : columns_) all.push_back(column.quantity.name);
  return all;
}

py::array_t<double> Recorded::array(const std::string& name) const {
  const Column& found = column(name);
  const auto rows = static_cast<py::ssize_t>(ticks_.size());
  const auto wide = static_cast<py::ssize_t>(found.quantity.units.size());
  std::vector<py::ssize_t> shape = {rows};
  if (!found.quantity.joints.empty()) shape.push_back(wide);
  return py::array_t<double>(shape, found.values.data());
}

const std::vector<std::string>& Recorded::units(const std::string& name) const {
  return column(name).quantity.units;
}

std::string Recorded::description(const std::string& name) const {
  return column(name).quantity.description;
}

py::array_t<std::int64_t> Recorded::ticks() const {
  return py::array_t<std::int64_t>(static_cast<py::ssize_t>(ticks_.size()), ticks_.data());
}

py::array_t<double> Recorded::time() const {
  py::array_t<double> t(static_cast<py::ssize_t>(ticks_.size()));
  std::transform(ticks_.begin(), ticks_.end(), t.mutable_data(),
                 [&](std::int64_t tick) { return static_cast<double>(tick) * period_s; });
  return t;
}

Recorded read(const std::filesystem::path& path, std::int64_t run) {
  const py::gil_scoped_release unlocked;
  logger::RunLog log =
      logger::RunLog::open(std::filesystem::is_directory(path) ? path / "lcmlog" : path,
                           run == 0 ? std::nullopt : std::optional(run));
  Recorded recorded(log.scenario(), {log.info().law, log.info().measurement, log.info().signals});
  recorded.run = log.run();
  loop::TickRecord record;
  while (log.next(record)) recorded.add(record);
  recorded.finish();
  return recorded;
}

Recorded simulate(const std::filesystem::path& path, const std::vector<std::string>& overrides,
                  const py::object& f, const std::string& name) {
  const bool own = !f.is_none();
  experiment::Scenario scenario = experiment::load_scenario(path, overrides);
  if (own && scenario.controller.law != experiment::external_law) {
    scenario.controller.measurement = controller::law_facts(scenario.controller.law).measurement;
    scenario.controller.law = experiment::external_law;
  }
  controller::ScenarioLaw law = own ? python_law(scenario, f, name, Interrupt::passed_on)
                                    : controller::scenario_law(scenario);
  const py::gil_scoped_release unlocked;
  Recorded recorded(scenario, controller::law_info(law));
  study::run_in_process(scenario, std::move(law), [&](const study::TickRecord& tick) {
    if (tick.tick % 1000 == 0) {  // Ctrl-C; seldom, for it waits for the lock
      const py::gil_scoped_acquire locked;
      if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    }
    loop::TickRecord record;
    record.tick = tick.tick;
    std::visit([&](const auto& measured) { record.measurement = measured; }, tick.measurement);
    record.reference = tick.reference;
    record.command = tick.command;
    record.controller_state = tick.controller;
    record.truth = plant::truth_of(tick.truth, tick.applied);
    recorded.add(record);
    return true;
  });
  recorded.finish();
  return recorded;
}

}  // namespace tachless::python
