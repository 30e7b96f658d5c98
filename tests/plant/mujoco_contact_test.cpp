// Contacts of a robot that MuJoCo moves: in the state, in the log and in the words of a stop.

#include <gmock/gmock.h>

#include <cmath>

#include "in_process/in_process_log.h"
#include "logger/log_file.h"
#include "logger/run_log.h"
#include "tests/plant/mujoco_plant.h"

namespace tachless::plant {
namespace {

using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;

/// The arm with a wall that its tip meets.
std::string arm_at_a_wall() {
  return arm(R"(<geom name="wall" type="box" size="0.02 1 1" pos="0.4 0 1"/>)");
}

TEST_F(MujocoPlant, NamesTheGeomsThatTouchAndTheirForce) {
  write("scene.xml", arm_at_a_wall());
  const auto free = records({"plant.mujoco.model=arm.xml"}),
             stopped = records({"plant.mujoco.model=scene.xml"});
  for (const TickRecord& each : free) {
    EXPECT_THAT(each.truth.contact->simulator, HasSubstr("MuJoCo "));
    EXPECT_EQ(each.truth.contact->geoms, "");
    EXPECT_EQ(each.truth.contact->force, 0);
  }
  EXPECT_EQ(free.back().truth.disturbance.cwiseAbs().maxCoeff(), 0);
  EXPECT_GT((free.back().truth.q - stopped.back().truth.q).norm(), 0.01);
  EXPECT_GT(stopped.back().truth.disturbance.cwiseAbs().maxCoeff(), 1);
  EXPECT_EQ(stopped.front().truth.contact->geoms, "");
  EXPECT_EQ(stopped.back().truth.contact->geoms, "tip, wall");
  EXPECT_GT(stopped.back().truth.contact->force, 10);
}

/// A tray that a vertical drive holds, and a box of 2 kg on it.
constexpr const char* tray = R"(<mujoco model="tray"><compiler angle="radian"/>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 0.1"/>
    <body name="box" pos="0 0 0.571"><freejoint/>
      <geom name="box" type="box" size="0.05 0.05 0.05" mass="2"/></body>
    <body name="tray" pos="0 0 0.5"><joint name="lift" type="slide" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
      <geom name="plate" type="box" size="0.2 0.2 0.02"/></body>
  </worldbody></mujoco>)";

TEST_F(MujocoPlant, FeelsTheWeightOfABox) {
  write("arm.xml", tray);
  write("tray.yaml", open_loop_text(Vector::Zero(1)));
  std::vector<TickRecord> all;
  in_process::run_in_process(
      scenario::load_scenario(directory_ / "tray.yaml",
                              {"plant.mujoco.model=arm.xml", "plant.initial.torque=hold",
                               "controller.gains={kp: 4000, kd: 200, a: 100, b: 100}"}),
      [&](const TickRecord& record) {
        all.push_back(record);
        return true;
      });
  const double weight = 2 * 9.81;
  const ArmState& last = all.back().truth;
  EXPECT_EQ(last.contact->geoms, "plate, box");
  EXPECT_NEAR(last.contact->force / weight, 1, 1e-3);
  EXPECT_NEAR(-last.disturbance[0] / weight, 1, 1e-3);
}

TEST_F(MujocoPlant, HasItsContactsInTheLog) {
  write("scene.xml", arm_at_a_wall());
  const auto scenario =
      scenario::load_scenario(directory_ / "arm.yaml", {"plant.mujoco.model=scene.xml"});
  std::vector<TickRecord> all;
  {
    logger::LogWriter file(directory_ / "log");
    in_process::log_in_process(
        scenario, controller::scenario_law(scenario), 7,
        [&](const in_process::LogMessage& message) {
          file.append(message.utime, message.channel, message.data);
        },
        [&](const TickRecord& record) {
          all.push_back(record);
          return true;
        });
    file.close();
  }
  logger::RunLog log = logger::RunLog::open(directory_ / "log");
  for (logger::TickRecord record; log.next(record);) {
    const auto& contact = all[static_cast<std::size_t>(record.tick)].truth.contact;
    ASSERT_TRUE(record.contact);
    EXPECT_EQ(record.contact->geoms, contact->geoms);
    EXPECT_EQ(record.contact->force, contact->force);
    EXPECT_EQ(record.contact->simulator, contact->simulator);
  }
  EXPECT_EQ(log.summary().of(logger::Slot::contact).count, all.size());
  EXPECT_TRUE(log.summary().gap_texts().empty());
}

// examples/mujoco/push_box.yaml
TEST_F(MujocoPlant, PushesTheBoxOfTheExample) {
  const auto scenario =
      scenario::load_scenario(TACHLESS_SOURCE_DIR "/examples/mujoco/push_box.yaml");
  double first_s = 0, largest = 0, sliding = 0;
  int begins = 0;
  ArmState last;
  in_process::run_in_process(scenario, [&](const TickRecord& record) {
    const bool touched = last.contact && last.contact->force > 0;
    last = record.truth;
    EXPECT_THAT(last.contact->geoms, AnyOf("", "paddle, box"));
    if (last.contact->force > 0 && first_s == 0) first_s = record.time_s;
    if (last.contact->force > 0 && !touched) ++begins;
    largest = std::max(largest, last.contact->force);
    if (record.time_s > first_s + 0.15) sliding = std::max(sliding, last.contact->force);
    return true;
  });
  // The paddle meets the box a third of the way on, where the motion is fast.
  EXPECT_NEAR(first_s, 1, 0.3);
  // Dry friction of half the box's weight has to be overcome.
  EXPECT_GT(largest, 0.5 * 2 * 9.81 * 0.9);
  EXPECT_LT(largest, 1000);
  // After the impact the box slides on the table: it neither hops nor chatters, and friction of
  // half its weight is nearly all of the force. The rest accelerates it.
  EXPECT_EQ(begins, 1);
  EXPECT_LT(sliding, 1.3 * 0.5 * 2 * 9.81);
  EXPECT_NEAR(last.q[0], 0.5, 0.01);
}

TEST_F(MujocoPlant, IsAskedForContactsFirstWhenItStopsByFollowingError) {
  write("scene.xml", arm_at_a_wall());
  EXPECT_THAT(
      refusal({"plant.mujoco.model=scene.xml", "plant.following_error_rad=0.02"}),
      AllOf(HasSubstr("contact (tip, wall), "), HasSubstr("first see whether the arm touches")));
}

}  // namespace
}  // namespace tachless::plant
