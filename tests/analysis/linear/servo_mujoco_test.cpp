// The largest stable step of position actuators against the behaviour of MuJoCo.

#include <gtest/gtest.h>
#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>

#include "tests/analysis/linear/servo_models.h"
#include "tests/support/temporary_directory.h"

namespace tachless::linear {
namespace {

using namespace linear::testing;

constexpr double kick = 1e-6;  // [rad/s; m/s]

/// Returns the largest speed over the last steps of many after a small kick in all joints.
double speed_after_a_kick(const std::string& text, ServoStep kind, const Vector& posture,
                          double step_s) {
  const TemporaryDirectory directory;
  const auto file = directory / "model.xml";
  std::ofstream(file) << text;
  char why[1000] = "";
  const std::unique_ptr<mjModel, void (*)(mjModel*)> m(
      mj_loadXML(file.c_str(), nullptr, why, sizeof why), mj_deleteModel);
  EXPECT_NE(m, nullptr) << why;
  const std::unique_ptr<mjData, void (*)(mjData*)> d(mj_makeData(m.get()), mj_deleteData);
  const bool held = kind == ServoStep::held;
  constexpr int substeps = 10;
  m->opt.integrator = kind == ServoStep::euler      ? mjINT_EULER
                      : kind == ServoStep::implicit ? mjINT_IMPLICIT
                                                    : mjINT_RK4;
  m->opt.timestep = held ? step_s / substeps : step_s;
  const ServoGains gains = gains_of(text);
  for (int j = 0; j < m->nv; ++j) {
    d->qpos[j] = posture[j];
    d->qvel[j] = kick;
    // The control that has `posture` at rest: the gain is kp of the actuator's side of the gear.
    d->ctrl[j] = posture[j] * m->actuator_gear[6 * j];
  }
  if (held) std::fill_n(m->actuator_gear, 6 * m->nu, 0.0);
  constexpr int steps = 6000, last = 100;
  double fastest = 0;
  for (int k = 0; k < steps; ++k) {
    for (int j = 0; held && j < m->nv; ++j) {
      d->qfrc_applied[j] = gains.kp[j] * (posture[j] - d->qpos[j]) - gains.kv[j] * d->qvel[j];
    }
    for (int s = 0; s < (held ? substeps : 1); ++s) mj_step(m.get(), d.get());
    if (k < steps - last) continue;
    for (int j = 0; j < m->nv; ++j) fastest = std::max(fastest, std::abs(d->qvel[j]));
  }
  return fastest;
}

class AgainstMuJoCo : public ::testing::TestWithParam<std::string> {};

TEST_P(AgainstMuJoCo, TheLimitLiesBetweenDecayAndGrowth) {
  const std::string& text = GetParam();
  const ServoLoop loop(model_of(text), gains_of(text), {});
  int limited = 0;
  for (const ServoStep kind : all_servo_steps) {
    const ServoLimit limit = loop.limit(kind);
    if (std::isinf(limit.step_s)) continue;
    ++limited;
    const auto name = names(kind)[static_cast<std::size_t>(kind)];
    const Vector& q = limit.posture;
    EXPECT_LT(speed_after_a_kick(text, kind, q, 0.98 * limit.step_s), kick / 2) << name;
    EXPECT_GT(speed_after_a_kick(text, kind, q, 1.02 * limit.step_s), 100 * kick) << name;
  }
  EXPECT_GE(limited, 3);
}

INSTANTIATE_TEST_SUITE_P(ThreeArms, AgainstMuJoCo,
                         ::testing::Values(light_wrist, stiff_arm, crane));

}  // namespace
}  // namespace tachless::linear
