#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "logger/table.h"

/// A run as arrays, simulated or read from a log.
namespace tachless::python {

namespace py = pybind11;

class Recorded {
 public:
  Recorded(const experiment::Scenario& scenario, const loop::LawInfo& law);

  /// One tick; what the record does not have is NaN.
  void add(const loop::TickRecord& record);
  /// Without the quantities that no record had. No more may be added.
  void finish();

  std::string scenario, law, text;
  std::int64_t run = 0;
  double period_s = 0;
  std::vector<std::string> joints;

  [[nodiscard]] std::vector<std::string> names() const;
  /// (ticks, joints), or (ticks,) of a quantity of no joint.
  /// @throw py::key_error naming what there is
  [[nodiscard]] py::array_t<double> array(const std::string& name) const;
  [[nodiscard]] const std::vector<std::string>& units(const std::string& name) const;
  [[nodiscard]] std::string description(const std::string& name) const;
  [[nodiscard]] py::array_t<std::int64_t> ticks() const;
  [[nodiscard]] py::array_t<double> time() const;

 private:
  struct Column {
    logger::Quantity quantity;
    std::vector<double> values;
    bool any = false;
  };
  [[nodiscard]] const Column& column(const std::string& name) const;

  std::vector<Column> columns_;
  std::vector<std::int64_t> ticks_;
};

/// @param path a log, or a run's directory
Recorded read(const std::filesystem::path& path, std::int64_t run);

/// @param f law in place of the scenario's, a Python callable; None: the scenario's
Recorded simulate(const std::filesystem::path& scenario, const std::vector<std::string>& overrides,
                  const py::object& f, const std::string& name);

}  // namespace tachless::python
