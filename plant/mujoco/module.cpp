// The module of plant.mujoco. It uses no library of tachless.

#include <mujoco/mujoco.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "plant/mujoco/interface.h"

namespace tachless::plant {
namespace {

[[noreturn]] void fail(const std::string& problem) {
  throw std::runtime_error("MuJoCo: " + problem);
}

// By itself MuJoCo ends the process on an error, and writes a file MUJOCO_LOG.TXT on a warning.
void on_error(const char* text) { fail(text); }
void on_warning(const char* /*text*/) {}  // `require_sound` looks at the warnings

struct Delete {
  void operator()(mjModel* model) const { mj_deleteModel(model); }
  void operator()(mjData* data) const { mj_deleteData(data); }
};
using ModelPointer = std::unique_ptr<mjModel, Delete>;

ModelPointer load(const std::string& file) {
  mju_user_error = on_error;
  mju_user_warning = on_warning;
  char why[1000] = "";
  ModelPointer model(mj_loadXML(file.c_str(), nullptr, why, sizeof why));
  if (model == nullptr) {
    std::string text = why;
    text.erase(text.find_last_not_of(" \n") + 1);
    fail(text + "; this is MuJoCo " + mj_versionString() +
         ": change the model to what it reads, build the module with another MuJoCo, or leave out "
         "plant.mujoco.model");
  }
  return model;
}

/// Steps a MuJoCo model. The joints' torque is qfrc_applied. Actuators of these joints have no
/// effect; others keep their control.
class Mujoco final : public MujocoSimulator {
 public:
  explicit Mujoco(const MujocoRequest& request)
      : model_(load(request.model)),
        data_(mj_makeData(model_.get())),
        braking_(Vector::Zero(request.num_joints)) {
    set_options(request);
    G_ = Matrix::Zero(model_->nv, request.num_joints);
    driven_.assign(static_cast<std::size_t>(request.num_joints), 0);
    for (const MujocoJoint& joint : request.joints) add(joint);
    find_robot();
  }

  void reset(const ArmState& initial) override {
    now_s_ = 0;
    braking_.setZero();
    begin(initial.q, initial.v);
    mj_forward(model_.get(), data_.get());
    require_sound();
  }

  ArmState state() override {
    ArmState state{Vector(G_.cols()), Vector(G_.cols()), {}, {}};
    for (std::size_t i = 0; i < driven_.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      state.q[at] = data_->qpos[model_->jnt_qposadr[driven_[i]]];
      state.v[at] = data_->qvel[model_->jnt_dofadr[driven_[i]]];
    }
    state.disturbance = contact_torque();
    state.contact = contact();
    return state;
  }

  void advance(const Vector& tau, double until_s) override {
    // Steps of one length fill the time, so that none reaches across a jump of the torque.
    const double whole_s = until_s - now_s_;
    const double steps = std::max(1.0, std::ceil(whole_s / longest_step_s_ * (1 - 1e-9)));
    // The model's own step where it fits: a loop of mj_step then computes the same bits.
    const bool fits = std::abs(whole_s / steps / longest_step_s_ - 1) <= 1e-9;
    model_->opt.timestep = fits ? longest_step_s_ : whole_s / steps;
    for (double k = 0; k < steps; ++k) {
      for (std::size_t i = 0; i < driven_.size(); ++i) {
        const auto at = static_cast<Eigen::Index>(i);
        const int dof = model_->jnt_dofadr[driven_[i]];
        data_->qfrc_applied[dof] = tau[at] - braking_[at] * data_->qvel[dof];
      }
      mj_step(model_.get(), data_.get());
      require_sound();
    }
    now_s_ = until_s;
  }

  void brake(const Vector& damping) override { braking_ = damping; }

  void evaluate(const Vector& q, Matrix& M, Vector& gravity) override {
    begin(q, Vector::Zero(q.size()));
    mj_forward(model_.get(), data_.get());
    Eigen::MatrixXd MG(model_->nv, G_.cols());
    std::vector<mjtNum> column(static_cast<std::size_t>(model_->nv)), product(column);
    for (Eigen::Index j = 0; j < G_.cols(); ++j) {
      for (Eigen::Index i = 0; i < G_.rows(); ++i) column[static_cast<std::size_t>(i)] = G_(i, j);
      mj_mulM(model_.get(), data_.get(), product.data(), column.data());
      for (Eigen::Index i = 0; i < G_.rows(); ++i) MG(i, j) = product[static_cast<std::size_t>(i)];
    }
    M = G_.transpose() * MG;
    gravity = in_coordinates(data_->qfrc_bias);
  }

  [[nodiscard]] std::string version() const override {
    return std::string("MuJoCo ") + mj_versionString();
  }

 private:
  void set_options(const MujocoRequest& request) {
    mjOption& option = model_->opt;
    if (request.integrator == MujocoIntegrator::euler) option.integrator = mjINT_EULER;
    if (request.integrator == MujocoIntegrator::implicit) option.integrator = mjINT_IMPLICIT;
    if (request.integrator == MujocoIntegrator::rk4) option.integrator = mjINT_RK4;
    longest_step_s_ = request.step_s > 0 ? request.step_s : option.timestep;
    if (request.keyframe.empty()) return;
    keyframe_ = mj_name2id(model_.get(), mjOBJ_KEY, request.keyframe.c_str());
    if (keyframe_ < 0) {
      fail("no keyframe \"" + request.keyframe + "\"; correct plant.mujoco.keyframe");
    }
  }

  void add(const MujocoJoint& joint) {
    const int id = mj_name2id(model_.get(), mjOBJ_JOINT, joint.name.c_str());
    if (id < 0) {
      fail("no joint \"" + joint.name +
           "\", which the scenario's robot has; give the joint that name in the model");
    }
    const int type = model_->jnt_type[id];
    if (type != mjJNT_HINGE && type != mjJNT_SLIDE) {
      fail("joint \"" + joint.name + "\" is neither hinge nor slide");
    }
    if (!joint.driven && !is_bound(id)) {
      fail("joint \"" + joint.name +
           "\" mimics another in the scenario's robot and moves freely here; add an "
           "<equality><joint>");
    }
    G_(model_->jnt_dofadr[id], joint.coordinate) = joint.multiplier;
    if (joint.driven) driven_[static_cast<std::size_t>(joint.coordinate)] = id;
    joints_.emplace_back(joint, id);
    for (int a = 0; a < model_->nu; ++a) {
      const int kind = model_->actuator_trntype[a];
      if (kind != mjTRN_JOINT && kind != mjTRN_JOINTINPARENT) continue;
      if (model_->actuator_trnid[2 * a] != id) continue;
      model_->actuator_gaintype[a] = mjGAIN_FIXED;
      model_->actuator_biastype[a] = mjBIAS_NONE;
      std::fill_n(model_->actuator_gainprm + mjNGAIN * a, mjNGAIN, 0.0);
    }
  }

  /// Returns whether an equality binds the joint to another.
  [[nodiscard]] bool is_bound(int joint) const {
    for (int e = 0; e < model_->neq; ++e) {
      if (model_->eq_type[e] != mjEQ_JOINT || model_->eq_obj2id[e] < 0) continue;
      if (model_->eq_obj1id[e] == joint || model_->eq_obj2id[e] == joint) return true;
    }
    return false;
  }

  /// Begins anew with this state of the scenario's joints.
  void begin(const Vector& q, const Vector& v) {
    if (keyframe_ < 0) {
      mj_resetData(model_.get(), data_.get());
    } else {
      mj_resetDataKeyframe(model_.get(), data_.get(), keyframe_);
    }
    for (const auto& [joint, id] : joints_) {
      data_->qpos[model_->jnt_qposadr[id]] = joint.multiplier * q[joint.coordinate] + joint.offset;
      data_->qvel[model_->jnt_dofadr[id]] = joint.multiplier * v[joint.coordinate];
    }
  }

  /// MuJoCo resets a state that runs away to its initial one, without a word.
  void require_sound() const {
    for (const int each : {mjWARN_BADQPOS, mjWARN_BADQVEL, mjWARN_BADQACC, mjWARN_INERTIA}) {
      const mjWarningStat& warning = data_->warning[each];
      if (warning.number > 0) fail(mju_warningText(each, warning.lastinfo));
    }
  }

  [[nodiscard]] Vector in_coordinates(const mjtNum* force) const {
    Vector sum = Vector::Zero(G_.cols());
    for (Eigen::Index j = 0; j < G_.cols(); ++j) {
      for (Eigen::Index i = 0; i < G_.rows(); ++i) sum[j] += G_(i, j) * force[i];
    }
    return sum;
  }

  /// Returns the torque of the contacts of the last step.
  [[nodiscard]] Vector contact_torque() {
    force_.assign(static_cast<std::size_t>(data_->nefc), 0);
    bool any = false;
    for (int i = 0; i < data_->nefc; ++i) {
      const int type = data_->efc_type[i];
      if (type < mjCNSTR_CONTACT_FRICTIONLESS) continue;
      force_[static_cast<std::size_t>(i)] = data_->efc_force[i];
      any = true;
    }
    if (!any) return Vector::Zero(G_.cols());
    torque_.resize(static_cast<std::size_t>(model_->nv));
    mj_mulJacTVec(model_.get(), data_.get(), torque_.data(), force_.data());
    return in_coordinates(torque_.data());
  }

  /// Finds the bodies that move with the scenario's joints.
  void find_robot() {
    robot_.assign(static_cast<std::size_t>(model_->nbody), false);
    for (const auto& [joint, id] : joints_) robot_[index(model_->jnt_bodyid[id])] = true;
    for (int body = 1; body < model_->nbody; ++body) {  // a parent is before its children
      robot_[index(body)] = robot_[index(body)] || robot_[index(model_->body_parentid[body])];
    }
  }

  [[nodiscard]] bool is_robot(int geom) const { return robot_[index(model_->geom_bodyid[geom])]; }

  /// Returns the geom's name, or that of its body.
  [[nodiscard]] std::string name(int geom) const {
    const char* own = mj_id2name(model_.get(), mjOBJ_GEOM, geom);
    if (own == nullptr) own = mj_id2name(model_.get(), mjOBJ_BODY, model_->geom_bodyid[geom]);
    return own != nullptr ? own : "geom " + std::to_string(geom);
  }

  /// Returns the pair of geoms that presses the robot most, at the begin of the last step.
  [[nodiscard]] Contact contact() {
    forces_.clear();
    for (int i = 0; i < data_->ncon; ++i) {
      const mjContact& each = data_->contact[i];
      if (each.exclude != 0 || !(is_robot(each.geom1) || is_robot(each.geom2))) continue;
      mjtNum force[6], world[3];
      mj_contactForce(model_.get(), data_.get(), i, force);
      mju_rotVecMatT(world, force, each.frame);  // the rows of the frame are its axes
      const auto sum = forces_.try_emplace({each.geom1, each.geom2}, Eigen::Vector3d::Zero()).first;
      sum->second += Eigen::Vector3d(world[0], world[1], world[2]);
    }
    Contact most{version(), {}, 0};
    for (const auto& [geoms, force] : forces_) {
      if (force.norm() <= most.force) continue;
      most.force = force.norm();
      const auto [first, second] = geoms;
      most.geoms =
          is_robot(first) ? name(first) + ", " + name(second) : name(second) + ", " + name(first);
    }
    return most;
  }

  static std::size_t index(int number) { return static_cast<std::size_t>(number); }

  ModelPointer model_;
  std::unique_ptr<mjData, Delete> data_;
  Eigen::MatrixXd G_;        ///< velocities of the model's joints by those of the scenario's
  std::vector<int> driven_;  ///< joint of each coordinate
  std::vector<std::pair<MujocoJoint, int>> joints_;
  std::vector<mjtNum> force_, torque_;
  std::vector<bool> robot_;  ///< by body: it moves with the scenario's joints
  std::map<std::pair<int, int>, Eigen::Vector3d> forces_;  ///< by geoms [N]
  Vector braking_;
  double longest_step_s_ = 0, now_s_ = 0;
  int keyframe_ = -1;
};

}  // namespace

extern "C" __attribute__((visibility("default"))) MujocoSimulator* tachless_mujoco_2(
    const MujocoRequest& request) {
  return new Mujoco(request);
}

}  // namespace tachless::plant
