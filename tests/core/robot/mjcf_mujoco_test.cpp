// The reader of MuJoCo models against MuJoCo's own compiler and mechanics.

#include <gtest/gtest.h>
#include <mujoco/mujoco.h>

#include <fstream>
#include <memory>
#include <random>

#include "robot/dynamics.h"
#include "robot/mjcf.h"
#include "tests/core/robot/mjcf_models.h"
#include "tests/support/temporary_directory.h"

namespace tachless::robot {
namespace {

class Compiled {
 public:
  explicit Compiled(const char* text) {
    const TemporaryDirectory directory;
    const auto file = directory / "model.xml";
    std::ofstream(file) << text;
    char why[1000] = "";
    model_ = mj_loadXML(file.c_str(), nullptr, why, sizeof why);
    if (model_ == nullptr) throw std::runtime_error(why);
    data_ = mj_makeData(model_);
  }
  Compiled(const Compiled&) = delete;
  Compiled& operator=(const Compiled&) = delete;
  ~Compiled() {
    mj_deleteData(data_);
    mj_deleteModel(model_);
  }

  /// Computes M(q) and the bias force in the coordinates of `ours`, whose mimic joints MuJoCo has
  /// as coordinates of their own.
  void set_equations_of_motion(const Model& ours, const Vector& q, const Vector& v, Matrix& M,
                               Vector& bias) {
    Matrix G = Matrix::Zero(model_->nv, ours.num_joints);
    for (const Body& body : ours.bodies) {
      const int joint = mj_name2id(model_, mjOBJ_JOINT, body.joint.c_str());
      ASSERT_GE(joint, 0) << body.joint;
      G(model_->jnt_dofadr[joint], body.coordinate) = body.multiplier;
      data_->qpos[model_->jnt_qposadr[joint]] = body.multiplier * q[body.coordinate] + body.offset;
    }
    const Vector speed = G * v;
    for (int i = 0; i < model_->nv; ++i) data_->qvel[i] = speed[i];
    mj_forward(model_, data_);
    Matrix MG(model_->nv, ours.num_joints);
    for (int j = 0; j < ours.num_joints; ++j) {
      const Vector column = G.col(j);
      Vector product(model_->nv);
      mj_mulM(model_, data_, product.data(), column.data());
      MG.col(j) = product;
    }
    M = G.transpose() * MG;
    bias = G.transpose() * Vector::Map(data_->qfrc_bias, model_->nv);
  }

 private:
  mjModel* model_ = nullptr;
  mjData* data_ = nullptr;
};

/// Returns the largest difference of M and bias at 200 states, relative to their largest entries.
double largest_difference(const char* text) {
  const Description read =
      description_of_mjcf(text, "model.xml", [](const std::string&) { return std::string(); });
  const Model ours = model_from_urdf(read.urdf, "model.xml");
  Compiled theirs(text);
  std::mt19937 random(1);
  const auto draw = [&](double range) {
    Vector x(ours.num_joints);
    for (double& each : x) each = range * (2 * (random() / 4294967296.0) - 1);
    return x;
  };
  double worst = 0;
  for (int k = 0; k < 200; ++k) {
    const Vector q = draw(1.5), v = draw(3);
    Matrix M, M_theirs;
    Vector bias, bias_theirs;
    set_equations_of_motion(ours, q, v, M, bias);
    theirs.set_equations_of_motion(ours, q, v, M_theirs, bias_theirs);
    worst = std::max(worst, (M - M_theirs).cwiseAbs().maxCoeff() / M.cwiseAbs().maxCoeff());
    worst =
        std::max(worst, (bias - bias_theirs).cwiseAbs().maxCoeff() / bias.cwiseAbs().maxCoeff());
  }
  return worst;
}

// Two independent implementations: rounding of some 10 joints' transforms.
constexpr double rounding = 1e-12;

TEST(MjcfAgainstMuJoCo, ClassesOrientationsJointsAndReferencesAgree) {
  EXPECT_LT(largest_difference(testing::nested_model), rounding);
}

TEST(MjcfAgainstMuJoCo, MassesOfPrimitivesAgree) {
  EXPECT_LT(largest_difference(testing::primitive_model), rounding);
}

TEST(MjcfAgainstMuJoCo, JointsThatFollowOthersAgree) {
  EXPECT_LT(largest_difference(testing::gripper_model), rounding);
}

TEST(MjcfAgainstMuJoCo, BoundsAndBalanceOfInertiaAgree) {
  EXPECT_LT(largest_difference(testing::corrected_model), rounding);
}

TEST(MjcfAgainstMuJoCo, ProductsOfInertiaAgreeWithinItsEigenSolver) {
  // MuJoCo turns each inertia into principal moments, by a solver that stops at 1e-8.
  EXPECT_LT(largest_difference(testing::full_model), 1e-7);
}

}  // namespace
}  // namespace tachless::robot
