#pragma once

#include <filesystem>
#include <string>

#include "scenario/scenario.h"
#include "scenario/yaml_tree.h"

namespace tachless::scenario {

/// Adds the digest of the file of plant.mujoco.model, and of the files that it includes, to the
/// key's value: `scene.xml@0123456789abcdef`. Files of meshes are not part of the digest.
/// @throw Failure(bad_usage) for a file that cannot be read, and for a value that has the digest of
/// another model
void pin_model(YamlNode& root, const Scenario& scenario, const std::filesystem::path& directory);

/// Returns the file's name in a value of plant.mujoco.model, without a digest.
std::string without_digest(const std::string& model);

}  // namespace tachless::scenario
