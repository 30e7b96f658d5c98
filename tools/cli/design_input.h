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
    double period_s = 0;  ///< 0: the scenario's, 1 ms for a URDF
    /// Start of a URDF's motion [rad; m]; empty: chosen within the joints' ranges.
    std::vector<double> from;
    bool typical_rotors = false;   ///< a URDF's rotors by the rule of thumb
    std::filesystem::path output;  ///< paths are relative to it; empty: they are absolute
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

  /// Returns the assumptions in the scenario of a URDF alone, which neither URDF nor options state,
  /// each with the key that changes it. Empty for a scenario's file.
  [[nodiscard]] std::vector<std::string> assumptions(const scenario::Scenario& scenario) const;

 private:
  struct Urdf {
    std::string text, scenario;
    Vector typical_rotors;   ///< empty: not asked for
    bool in_mujoco = false;  ///< an MJCF with surroundings, and the module is there
  };
  [[nodiscard]] Urdf read_urdf(const scenario::RobotFile& file) const;
  [[nodiscard]] Vector from_posture(const robot::Model& model) const;
  [[nodiscard]] bool overridden(std::string_view key) const;

  Options options_;
  std::optional<Urdf> urdf_;
};

}  // namespace tachless::cli
