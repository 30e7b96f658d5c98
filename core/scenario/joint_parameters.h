#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "robot/mjcf_joints.h"
#include "robot/model.h"
#include "scenario/scenario.h"
#include "scenario/yaml_tree.h"

/// The file of `robot.joint_parameters`.
namespace tachless::scenario {

using JointParameters = std::map<std::string, robot::JointNumbers>;

/// Reads the numbers of the tree's file, by joint. Removes the key from the tree, whose text then
/// needs no file (`add_joint_parameters`). Returns nothing if the tree names no file.
/// @param scenario for complaints
/// @param directory of the scenario
/// @throw Failure(bad_usage) when the file cannot be read or has other contents
JointParameters take_joint_parameters(YamlNode& root, const Scenario& scenario,
                                      const std::filesystem::path& directory);

/// Writes the numbers of the model's joints into the tree, below the keys that have no numbers yet.
/// @throw Failure(bad_usage) when the file has no numbers of a joint
void add_joint_parameters(YamlNode& root, Scenario& scenario, const JointParameters& parameters,
                          const robot::Model& model);

}  // namespace tachless::scenario
