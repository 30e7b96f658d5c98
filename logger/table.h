#pragma once

#include <functional>
#include <string>
#include <vector>

#include "logger/run_log.h"

/// The columns of an export: which quantities a run has, by name, unit and place in a TickRecord.
namespace tachless::logger {

/// One vector or number per tick.
struct Quantity {
  std::string name;                ///< "q_ref"
  std::vector<std::string> units;  ///< per component: "rad", "m", "Nm", "N", "1" ...
  std::string description;
  Slot slot;                        ///< the message it comes from; missing with it
  std::vector<std::string> joints;  ///< as columns name them; empty: one number, of no joint
  bool whole = false;               ///< numbers are integers

  /// The values of a record that `has(record, slot)`: as many as `units`.
  std::function<void(const TickRecord&, double* values)> read;

  /// "q_ref_elbow_rad".
  [[nodiscard]] std::string column(std::size_t component) const;
};

/// The quantities that a log of the scenario under that law can hold. In order: truth (q, v, theta,
/// thetadot), reference, tau, the law's signals, measured values, and what the drives did.
std::vector<Quantity> quantities_of(const experiment::Scenario& scenario, const loop::LawInfo& law);
/// Those of this log's run, whether or not it holds them.
std::vector<Quantity> quantities_of(const RunLog& log);

}  // namespace tachless::logger
