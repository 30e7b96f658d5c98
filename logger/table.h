#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "logger/run_log.h"

/// The columns of an export: the quantities of a run by name, unit and place in a TickRecord.
namespace tachless::logger {

/// Returns a name such as "tau_elbow_Nm". Leaves out the unit "1".
std::string column_name(std::string_view quantity, std::string_view joint, std::string_view unit);

/// Returns the names of the joints in the columns. Returns their numbers from 1 if two columns had
/// the same name ("q_ref" of joint "a", and "q" of joint "ref_a").
std::vector<std::string> joints_in_columns(const std::vector<std::string>& quantities,
                                           const std::vector<std::string>& joint_names);

/// One vector or number per tick.
struct Quantity {
  std::string name;                ///< "q_ref"
  std::vector<std::string> units;  ///< per component: "rad", "m", "Nm", "N", "1" ...
  std::string description;
  Slot slot;                        ///< message that has the quantity
  std::vector<std::string> joints;  ///< names in the columns; empty: one number, of no joint

  /// Function that reads the values, one per unit, of a record for which `has(record, slot)`.
  std::function<void(const TickRecord&, double* values)> read;

  /// Returns a name such as "q_ref_elbow_rad".
  [[nodiscard]] std::string column(std::size_t component) const;
};

/// Appends the value as "%.17g" does, such as "1.5". The text reads back as the same double.
void add_number(std::string& text, double value);

/// Returns the quantities that a log of the scenario under that law can hold. Their order is truth
/// (q, v, theta, thetadot), reference, tau, the law's signals, measured values, and drive values.
std::vector<Quantity> quantities_of(const scenario::Scenario& scenario,
                                    const messages::LawInfo& law);

}  // namespace tachless::logger
