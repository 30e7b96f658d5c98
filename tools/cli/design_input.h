#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "design/structure.h"
#include "robot/model.h"
#include "scenario/scenario.h"

namespace tachless::cli {

/// Input file of `tachless design`, a scenario or a URDF alone, with the options about it. A URDF
/// is parsed once.
class DesignInput {
 public:
  struct Options {
    std::filesystem::path file;
    std::vector<std::string> overrides;
    double period_s = 0;  ///< period [s]; 0: the scenario's period, or 1 ms for a URDF
    /// Start of a URDF's motion [rad; m]; empty: chosen within the joints' ranges.
    std::vector<double> from;
    bool typical_rotors = false;  ///< rotors of a URDF get the inertia of the rule of thumb
    /// File to be written: paths in it are relative to its directory; empty: paths are absolute.
    std::filesystem::path output;
  };

  /// Reads the file.
  /// @throw base::Failure(bad_usage) for a file that describes no robot, or options that do not
  /// suit the file
  explicit DesignInput(Options options);

  [[nodiscard]] bool bare_urdf() const { return urdf_.has_value(); }

  /// Returns the scenario with these overrides. For a URDF alone it is the scenario made of the
  /// URDF.
  /// @param structure of the gains; nothing: the structure of the law
  [[nodiscard]] scenario::Scenario scenario(std::optional<design::Structure> structure,
                                            std::vector<std::string> more = {}) const;

  /// Returns the assumptions in the scenario of a URDF alone: facts that neither URDF nor options
  /// state. Each has the key that changes it. Empty for a scenario's file.
  [[nodiscard]] std::vector<std::string> assumptions(const scenario::Scenario& scenario) const;

 private:
  struct Urdf {
    std::string text, scenario;
    Vector typical_rotors;  ///< rotor inertia by the rule of thumb [kg m2]; empty: not asked for
    /// The file is an MJCF with surroundings, and the module mujoco.so is installed.
    bool in_mujoco = false;
  };
  [[nodiscard]] Urdf read_urdf(const scenario::RobotFile& file) const;
  [[nodiscard]] Vector from_posture(const robot::Model& model) const;
  [[nodiscard]] bool overridden(std::string_view key) const;

  Options options_;
  std::optional<Urdf> urdf_;
};

}  // namespace tachless::cli
