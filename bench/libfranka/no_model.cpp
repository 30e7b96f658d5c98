// The members of franka::Model to which the rest of libfranka refers, for a build without
// Pinocchio.
#include <franka/model.h>

#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#if __has_include("robot_model_base.h")
#include "robot_model_base.h"
#else  // before 0.20.5
#include <franka/robot_model_base.h>
#endif

namespace franka {

Model::Model(const std::string& /*urdf*/) {
  throw std::logic_error("this libfranka was built without franka::Model");
}
Model::Model(std::unique_ptr<RobotModelBase> model) : robot_model_(std::move(model)) {}
Model::~Model() noexcept = default;
Model::Model(Model&&) noexcept = default;
Model& Model::operator=(Model&&) noexcept = default;

}  // namespace franka
