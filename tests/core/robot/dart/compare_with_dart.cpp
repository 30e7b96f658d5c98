// Our mechanics against DART's (dartsim.github.io), an independent library: inverse dynamics,
// inertia matrix, gravity and forward dynamics of every URDF named, at random states. The program
// searches folders. Without arguments it takes the robots of this repository, as CTest does.
//
//   compare_with_dart [FILE.urdf | FOLDER]...
//
// The exit code is 1 when any result differs by more than 1e-10 of its largest component. A robot
// that we refuse is listed with the reason and is no difference. A robot that DART cannot read is
// listed too.

#include <fmt/core.h>
#include <tinyxml2.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <dart/dynamics/DegreeOfFreedom.hpp>
#include <dart/dynamics/Joint.hpp>
#include <dart/dynamics/Skeleton.hpp>
#include <dart/utils/urdf/DartLoader.hpp>
#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

#include "robot/dynamics.h"
#include "tests/core/robot/robots.h"

namespace {

namespace fs = std::filesystem;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using tachless::Vector;
using tachless::robot::Model;

constexpr double allowed = 1e-10;
constexpr int states = 10;

struct Robot {
  std::string name, urdf;
  tachless::robot::UrdfOptions options = {};
};

/// Removes the elements that need other files, such as meshes.
void strip(tinyxml2::XMLElement& parent) {
  for (tinyxml2::XMLElement* child = parent.FirstChildElement(); child != nullptr;) {
    tinyxml2::XMLElement* const next = child->NextSiblingElement();
    const std::string name = child->Name();
    if (name == "visual" || name == "collision" || name == "gazebo" || name == "transmission") {
      parent.DeleteChild(child);
    } else {
      strip(*child);
    }
    child = next;
  }
}

std::string without_shapes(const std::string& urdf) {
  tinyxml2::XMLDocument document;
  document.Parse(urdf.c_str());
  if (document.RootElement() == nullptr) return urdf;
  strip(*document.RootElement());
  tinyxml2::XMLPrinter printer;
  document.Accept(&printer);
  return printer.CStr();
}

/// DART's robot in our coordinates: x = S q + offset, where S has a row for each joint of DART.
class Dart {
 public:
  Dart(const Robot& robot, const Model& model) {
    using dart::utils::DartLoader;
    // A link without an <inertial> has no mass, as in the specification; by default DART gives it 1
    // kg.
    const dart::dynamics::Inertia none(0, Eigen::Vector3d::Zero(), Eigen::Matrix3d::Zero());
    DartLoader loader(DartLoader::Options(nullptr, DartLoader::RootJointType::FIXED, none));
    skeleton_ = loader.parseSkeletonString(without_shapes(robot.urdf), dart::common::Uri());
    if (skeleton_ == nullptr) return;
    skeleton_->setGravity(model.gravity);
    const auto count = static_cast<Index>(skeleton_->getNumDofs());
    S_ = MatrixXd::Zero(count, model.num_joints);
    offset_ = VectorXd::Zero(count);
    for (Index i = 0; i < count; ++i) {
      auto* const dof = skeleton_->getDof(static_cast<std::size_t>(i));
      dof->setDampingCoefficient(0);
      dof->setCoulombFriction(0);
      const std::string joint = dof->getJoint()->getName();
      const auto body = std::find_if(model.bodies.begin(), model.bodies.end(),
                                     [&](const auto& each) { return each.joint == joint; });
      if (body != model.bodies.end()) {
        S_(i, body->coordinate) = body->multiplier;
        offset_[i] = body->offset;
      } else if (const auto lock = robot.options.locked.find(joint);
                 lock != robot.options.locked.end()) {
        offset_[i] = lock->second;
      }
    }
  }

  [[nodiscard]] bool readable() const { return skeleton_ != nullptr; }

  /// Runs the recursive Newton-Euler algorithm.
  [[nodiscard]] VectorXd inverse_dynamics(const VectorXd& q, const VectorXd& v, const VectorXd& a) {
    place(q, v);
    skeleton_->setAccelerations(S_ * a);
    skeleton_->computeInverseDynamics();
    return S_.transpose() * skeleton_->getForces();
  }
  [[nodiscard]] MatrixXd mass_matrix(const VectorXd& q) {
    place(q, VectorXd::Zero(q.size()));
    return S_.transpose() * skeleton_->getMassMatrix() * S_;
  }
  [[nodiscard]] VectorXd gravity(const VectorXd& q) {
    place(q, VectorXd::Zero(q.size()));
    return S_.transpose() * skeleton_->getGravityForces();
  }
  /// Runs the articulated-body algorithm. If joints depend on each other, it solves the equation of
  /// motion in the independent coordinates instead.
  [[nodiscard]] VectorXd forward_dynamics(const VectorXd& q, const VectorXd& v,
                                          const VectorXd& tau) {
    if (!(S_.rows() == S_.cols() && S_.isIdentity(0))) {
      const VectorXd bias = inverse_dynamics(q, v, VectorXd::Zero(q.size()));
      return mass_matrix(q).llt().solve(tau - bias);
    }
    place(q, v);
    skeleton_->setForces(tau);
    skeleton_->computeForwardDynamics();
    return skeleton_->getAccelerations();
  }

 private:
  void place(const VectorXd& q, const VectorXd& v) {
    skeleton_->setPositions(S_ * q + offset_);
    skeleton_->setVelocities(S_ * v);
  }

  dart::dynamics::SkeletonPtr skeleton_;
  MatrixXd S_;
  VectorXd offset_;
};

/// Returns the largest difference, relative to our largest component if that is not 0.
double difference(const MatrixXd& ours, const MatrixXd& theirs) {
  const double largest = theirs.cwiseAbs().maxCoeff();
  const double apart = (ours - theirs).cwiseAbs().maxCoeff();
  return largest > 0 ? apart / largest : apart;
}

struct Differences {
  double inverse = 0, inertia = 0, gravity = 0, forward = 0;
  [[nodiscard]] double largest() const { return std::max({inverse, inertia, gravity, forward}); }
};

Differences compare(const Model& model, Dart& dart) {
  tachless::robot::testing::Random random(1);
  Differences worst;
  const auto keep = [](double& kept, double found) { kept = std::max(kept, found); };
  for (int k = 0; k < states; ++k) {
    const int n = model.num_joints;
    const Vector q = random.vector(n, 1), v = random.vector(n, 1), a = random.vector(n, 1);
    const Vector tau = tachless::robot::inverse_dynamics(model, q, v, a);
    keep(worst.inverse, difference(tau, dart.inverse_dynamics(q, v, a)));
    keep(worst.inertia, difference(tachless::robot::mass_matrix(model, q), dart.mass_matrix(q)));
    // Gravity torques may be rounding alone, so the scale includes the torque of the motion.
    const VectorXd gravity = dart.gravity(q);
    const Vector own = tachless::robot::gravity_torque(model, q);
    keep(worst.gravity, (own - gravity).cwiseAbs().maxCoeff() /
                            std::max(gravity.cwiseAbs().maxCoeff(), tau.cwiseAbs().maxCoeff()));
    keep(worst.forward, difference(tachless::robot::forward_dynamics(model, q, v, tau),
                                   dart.forward_dynamics(q, v, tau)));
  }
  return worst;
}

std::vector<Robot> own_robots() {
  using tachless::robot::testing::chain_urdf;
  using tachless::robot::testing::read_text;
  const std::string root = TACHLESS_SOURCE_DIR;
  std::vector<Robot> all;
  for (const auto& file : fs::directory_iterator(root + "/scenarios/robots")) {
    all.push_back({file.path().filename().string(), read_text(file.path().string())});
  }
  const std::string branching = read_text(root + "/tests/core/robot/branching.urdf");
  all.push_back({"branching: branches, prismatic, mimic", branching});
  const Model model = tachless::robot::model_from_urdf(branching, "branching.urdf");
  Robot locked{"branching, a joint locked", branching};
  locked.options.locked[model.joint_names.front()] = 0.3;
  all.push_back(locked);
  all.push_back({"chain of 64 joints", chain_urdf(64)});
  all.push_back({"chain of 30 joints and 3 mimics", chain_urdf(30, 3)});
  return all;
}

std::vector<Robot> named_robots(const std::vector<std::string>& arguments) {
  std::vector<fs::path> files;
  for (const std::string& argument : arguments) {
    if (!fs::is_directory(argument)) {
      files.emplace_back(argument);
      continue;
    }
    for (const auto& each : fs::recursive_directory_iterator(argument)) {
      if (each.path().extension() == ".urdf") files.push_back(each.path());
    }
  }
  std::sort(files.begin(), files.end());
  std::vector<Robot> all;
  for (const fs::path& file : files) {
    all.push_back({file.string(), tachless::robot::testing::read_text(file.string())});
  }
  return all;
}

/// Prints one line of the table. Returns true if the two agree.
bool report(const Robot& robot) {
  Model model;
  try {
    model = tachless::robot::model_from_urdf(robot.urdf, robot.name, robot.options);
  } catch (const std::invalid_argument& refusal) {
    std::cout << fmt::format("refused   {}\n", refusal.what());
    return true;
  }
  Dart dart(robot, model);
  if (!dart.readable()) {
    std::cout << fmt::format("not read  {}: DART cannot\n", robot.name);
    return true;
  }
  const Differences found = compare(model, dart);
  const bool agree = found.largest() <= allowed;
  std::cout << fmt::format("{}  {:2} joints  ID {:.1e}  M {:.1e}  g {:.1e}  FD {:.1e}  {}\n",
                           agree ? "agree   " : "DIFFER  ", model.num_joints, found.inverse,
                           found.inertia, found.gravity, found.forward, robot.name);
  return agree;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const std::vector<std::string> arguments(argv + 1, argv + argc);
    const std::vector<Robot> robots = arguments.empty() ? own_robots() : named_robots(arguments);
    const auto differ = std::count_if(robots.begin(), robots.end(),
                                      [](const Robot& each) { return !report(each); });
    std::cout << fmt::format("{} robots, {} differ by more than {:g}\n", robots.size(), differ,
                             allowed);
    return differ == 0 && !robots.empty() ? 0 : 1;
  } catch (const std::exception& problem) {
    std::cerr << problem.what() << "\n";
    return 2;
  }
}
