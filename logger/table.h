#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "logger/run_log.h"

/// The columns of an export: which quantities a run has, by name, unit and place in a TickRecord.
namespace tachless::logger {

/// "tau_elbow_Nm"; no `unit` where that is "1".
std::string column_name(std::string_view quantity, std::string_view joint, std::string_view unit);

/// What stands for the joints in the columns' names: their names, or their numbers from 1 where two
/// columns would be called the same ("q_ref" of joint "a", and "q" of one called "ref_a").
std::vector<std::string> joints_in_columns(const std::vector<std::string>& quantities,
                                           const std::vector<std::string>& joint_names);

/// One vector or number per tick.
struct Quantity {
  std::string name;                ///< "q_ref"
  std::vector<std::string> units;  ///< per component: "rad", "m", "Nm", "N", "1" ...
  std::string description;
  Slot slot;                        ///< the message it comes from; missing with it
  std::vector<std::string> joints;  ///< as columns name them; empty: one number, of no joint

  /// The values of a record that `has(record, slot)`: as many as `units`.
  std::function<void(const TickRecord&, double* values)> read;

  /// "q_ref_elbow_rad".
  [[nodiscard]] std::string column(std::size_t component) const;
};

/// Appends "1.5", as "%.17g": reads back as the same double.
void add_number(std::string& text, double value);

/// The quantities that a log of the scenario under that law can hold. In order: truth (q, v, theta,
/// thetadot), reference, tau, the law's signals, measured values, and what the drives did.
std::vector<Quantity> quantities_of(const scenario::Scenario& scenario,
                                    const messages::LawInfo& law);

}  // namespace tachless::logger
