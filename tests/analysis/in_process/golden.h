#pragma once

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "in_process/in_process_loop.h"
#include "scenario/scenario.h"

/// The tables of tests/golden and the scenarios that they were computed for.
namespace tachless::in_process::testing {

class Golden {
 public:
  explicit Golden(const std::string& name) {
    const std::string path = std::string(TACHLESS_SOURCE_DIR) + "/tests/golden/" + name + ".csv";
    std::ifstream in(path);
    if (!in) throw std::runtime_error("cannot read " + path);
    std::string line, cell;
    std::getline(in, line);
    std::istringstream header(line);
    for (int i = 0; std::getline(header, cell, ','); ++i) column_[cell] = i;
    while (std::getline(in, line)) {
      std::vector<double> row;
      std::istringstream cells(line);
      while (std::getline(cells, cell, ',')) row.push_back(std::stod(cell));
      if (row.size() != column_.size()) throw std::runtime_error("bad row in " + path);
      rows_.push_back(std::move(row));
    }
  }

  [[nodiscard]] std::size_t size() const { return rows_.size(); }
  [[nodiscard]] double time(std::size_t row) const { return rows_[row][0]; }
  /// Returns both joints' values of a quantity such as "q" or "nu1".
  [[nodiscard]] Vector value(std::size_t row, const std::string& quantity) const {
    Vector x(2);
    for (int i = 0; i < 2; ++i) {
      x[i] =
          rows_[row][static_cast<std::size_t>(column_.at(quantity + "_" + std::to_string(i + 1)))];
    }
    return x;
  }
  [[nodiscard]] double peak(const std::string& quantity) const {
    double peak = 0;
    for (std::size_t i = 0; i < size(); ++i) {
      peak = std::max(peak, value(i, quantity).cwiseAbs().maxCoeff());
    }
    return peak;
  }

 private:
  std::map<std::string, int> column_;
  std::vector<std::vector<double>> rows_;
};

inline bool contains(const std::string& name, const std::string& part) {
  return name.find(part) != std::string::npos;
}

/// Returns the scenario of a table from the parts of its name, at period `h_s` [s]. It lasts
/// `duration_s` and one tick more, so that the last row has a record.
inline scenario::Scenario golden_scenario(const std::string& name, double h_s, double duration_s) {
  const bool flexible = contains(name, "flexible");
  const bool paper = contains(name, "paper");
  std::ostringstream yaml;
  yaml.precision(17);
  yaml << "name: golden\n"
       << "robot:\n  urdf: two_link.urdf\n";
  if (flexible) {
    yaml << "  joints: {flexible: {stiffness_Nm_per_rad: [10000, 10000], "
            "rotor_inertia_kgm2: [0.1, 0.1]}}\n";
  }
  yaml << "plant:\n  integrator: {accuracy: 1.0e-11}\n  initial: {";
  if (contains(name, "offset")) yaml << "position_rad: [0.5, -0.5]";
  if (contains(name, "rest")) yaml << "position_rad: [0, 0]";
  if (contains(name, "on_reference")) yaml << "velocity_rad_per_s: [1, 1]";
  if (flexible) {
    const Golden golden(name);
    const Vector theta = golden.value(0, "theta"), rate = golden.value(0, "thetadot");
    yaml << ", motor_position_rad: [" << theta[0] << ", " << theta[1] << "]"
         << ", motor_velocity_rad_per_s: [" << rate[0] << ", " << rate[1] << "]";
  }
  yaml << "}\n"
       << "reference: {sinusoid: {amplitude_rad: [0.03183098861837907, 0.03183098861837907], "
          "frequency_hz: [5, 5]}}\n"
       << "controller:\n  law: loria_ortega_" << (flexible ? "flexible" : "rigid") << "\n";
  if (!flexible && paper) {
    yaml << "  gains: {kp: [5000, 6000], kd: [7000, 8800], a: [1000, 1000], b: [1000, 1000]}\n";
  } else if (!flexible) {
    yaml << "  gains: {kp: [40000, 2400], kd: [1000, 60], a: [1000, 1000], b: [1000, 1000]}\n";
  } else if (paper) {
    yaml << "  gains: {kp1: [10000, 10000], kd1: [7000, 8800], a1: [1000, 1000], "
            "b1: [1000, 1000], kp2: [10000, 10000], kd2: [7000, 8800], a2: [1000, 1000], "
            "b2: [1000, 1000]}\n";
  } else {
    yaml << "  gains: {kp1: [20000, 1500], kd1: [600, 30], a1: [250, 250], b1: [250, 250], "
            "kp2: [100, 100], kd2: [13, 20], a2: [1000, 1000], b2: [1000, 1000]}\n";
  }
  const char* filter = contains(name, "zoh")              ? "zero_order_hold"
                       : contains(name, "tustin")         ? "tustin"
                       : contains(name, "backward_euler") ? "backward_euler"
                                                          : "first_order_hold";
  const double ticks = std::round(duration_s / h_s) + 1;
  yaml << "  filter: " << filter
       << "\n  feedforward_lead: " << (contains(name, "lead") ? "half_tick_plus_delay" : "none")
       << "\n"
       << "loop: {period_s: " << h_s << ", duration_s: " << ticks * h_s
       << ", command_delay: " << (contains(name, "_d1_") ? 1 : 0) << "}\n";
  std::ifstream urdf(std::string(TACHLESS_SOURCE_DIR) + "/scenarios/robots/two_link.urdf");
  std::ostringstream urdf_text;
  urdf_text << urdf.rdbuf();
  return scenario::parse_scenario(yaml.str(), urdf_text.str(), name);
}

/// Steps the table's scenario and calls `visit(row, record)` at the tick of each row up to
/// `duration_s`.
template <class Visit>
void walk_rows(const Golden& golden, const scenario::Scenario& scenario, double duration_s,
               const Visit& visit) {
  std::size_t row = 0;
  run_in_process(scenario, [&](const TickRecord& record) {
    if (row < golden.size() &&
        std::llround(golden.time(row) / scenario.loop.period_s) == record.tick) {
      visit(row, record);
      ++row;
    }
    return row < golden.size() && golden.time(row) < duration_s + 1e-9;
  });
  if (row < golden.size() && golden.time(row) < duration_s) {
    throw std::logic_error("the run ended before the table");
  }
}

}  // namespace tachless::in_process::testing
