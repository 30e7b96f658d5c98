#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "experiment/scenario.h"

namespace tachless::identify {

enum class Kind { rotor, viscous, coulomb, payload };
inline constexpr std::array<std::string_view, 4> kind_names = {"rotor", "viscous", "coulomb",
                                                               "payload"};

/// The unknown parameters of a robot as one vector: each kind's joints in order, the payload's mass
/// as one number.
class Parameters {
 public:
  struct Entry {
    Kind kind;
    int joint;         ///< -1: the payload
    std::string name;  ///< "rotor elbow"
    std::string unit;
  };

  Parameters(const experiment::Scenario& scenario, const std::vector<Kind>& unknown);

  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }
  [[nodiscard]] Eigen::Index size() const { return std::ssize(entries_); }

  /// The scenario with these values in its plant, ideal encoders and native mechanics.
  [[nodiscard]] experiment::Scenario plant(const experiment::Scenario& scenario,
                                           const Eigen::VectorXd& values) const;

  /// "plant.drive.coulomb_friction_Nm=[1, 2]" …: what writes them into a scenario. Friction is what
  /// the law feeds forward, too.
  [[nodiscard]] std::vector<std::string> overrides(const Eigen::VectorXd& values) const;

 private:
  [[nodiscard]] std::vector<double> of(Kind kind, const Eigen::VectorXd& values) const;

  std::vector<Entry> entries_;
};

}  // namespace tachless::identify
