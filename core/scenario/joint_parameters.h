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

/// What the tree's file says, by joint; the key leaves the tree, whose text then has the numbers
/// (`add_joint_parameters`) and needs no file. Empty where the tree names none.
/// @param scenario for complaints @param directory of the scenario
/// @throw Failure(bad_usage) when it cannot be read or says something else
JointParameters take_joint_parameters(YamlNode& root, const Scenario& scenario,
                                      const std::filesystem::path& directory);

/// Writes the numbers of the model's joints into the tree, below the keys that do not have any yet.
/// @throw Failure(bad_usage) when the file has no numbers of a joint
void add_joint_parameters(YamlNode& root, Scenario& scenario, const JointParameters& parameters,
                          const robot::Model& model);

}  // namespace tachless::scenario
