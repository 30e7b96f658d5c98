// MuJoCo in the place of the emulator's mechanics, against these mechanics.

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>

#include <cmath>
#include <cstring>

#include "certify/prediction.h"
#include "identify/identify.h"
#include "plant/arm.h"
#include "tests/plant/mujoco_plant.h"

namespace tachless::plant {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST_F(MujocoPlant, ByRungeKuttaMovesAsTheEmulatorToTenDigits) {
  EXPECT_LT(error({"plant.mujoco.integrator=rk4"}), 1e-10);
}

/// Returns the largest difference of positions from those of this library's mechanics under the
/// same torques: gravity's at the start, and a sine that is `amplitude` [N m] at the first joint.
double open_loop_error(const std::filesystem::path& file, const Vector& start, double amplitude,
                       int ticks, const std::string& integrator) {
  const auto scenario = scenario::load_scenario(
      file, {"plant.mujoco={model: arm.xml, integrator: " + integrator + "}",
             "plant.mechanics=native", "plant.integrator.accuracy=1e-13"});
  const robot::Model model = plant_model(scenario);
  const auto theirs = mujoco_simulator(scenario, model);
  const ArmState state{start, Vector::Zero(start.size()), {}, {}};
  Arm ours = make_arm(scenario.plant, {}, model, state);
  theirs->reset(state);
  const Vector gravity = robot::gravity_torque(model, start);
  double worst = 0;
  for (int k = 0; k < ticks; ++k) {
    Vector tau = gravity;
    for (Eigen::Index i = 0; i < tau.size(); ++i) {
      tau[i] += amplitude / (1 + static_cast<double>(i)) * std::sin(0.005 * k * (1 + 0.2 * i));
    }
    const double end_s = 0.001 * (k + 1);
    ours.advance(tau, end_s);
    theirs->advance(tau, end_s);
    worst = std::max(worst, (ours.state().q - theirs->state().q).cwiseAbs().maxCoeff());
  }
  EXPECT_GT((ours.state().q - start).norm(), 0.1);
  return worst;
}

// Torques change by steps, so the error of the fourth order in a step of 1 ms is all that is left.
TEST_F(MujocoPlant, UnderTheSameTorquesIsTheEmulatorToElevenDigits) {
  const auto of = [&](const std::string& model, const Vector& start, double amplitude, int ticks,
                      const std::string& integrator) {
    write("arm.xml", model);
    write("open.yaml", open_loop_text(start));
    return open_loop_error(directory_ / "open.yaml", start, amplitude, ticks, integrator);
  };
  const Vector two = Eigen::Vector2d(0.7, -0.4);
  const double whole = of(two_links, two, 3, 500, "rk4"),
               half = of(two_links, two, 3, 500, "rk4, step_s: 0.0005");
  EXPECT_LT(whole, 1e-10);
  EXPECT_NEAR(whole / half, 16, 2);  // the rest is the emulator's accuracy of 1e-13
  Vector seven(7);
  seven << 0, 0.3, 0, 1.2, 0, 1, 0.4;
  EXPECT_LT(of(seven_joints(), seven, 5, 800, "rk4"), 1e-11);
  const std::string euler = "euler, step_s: ";
  EXPECT_NEAR(
      of(two_links, two, 3, 500, euler + "0.001") / of(two_links, two, 3, 500, euler + "0.0005"), 2,
      0.02);
}

TEST_F(MujocoPlant, GivesTheSameBitsEachTime) {
  const std::vector<std::string> settings = {"plant.mujoco.model=arm.xml",
                                             "plant.encoder.noise_std_rad=1e-5"};
  const auto once = records(settings), again = records(settings);
  ASSERT_EQ(once.size(), 500U);
  for (std::size_t k = 0; k < once.size(); ++k) {
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(std::memcmp(&once[k].truth.q[i], &again[k].truth.q[i], sizeof(double)), 0) << k;
    }
  }
}

TEST_F(MujocoPlant, RefusesAnotherRobotWithItsNumbers) {
  write("heavy.xml", arm("", "2.2"));
  EXPECT_THAT(refusal({"plant.mujoco.model=heavy.xml"}),
              AllOf(HasSubstr("another robot than arm.xml"), HasSubstr("in the model"),
                    HasSubstr("plant.mujoco.may_differ")));
  EXPECT_EQ(refusal({"plant.mujoco.model=heavy.xml", "plant.mujoco.may_differ=true"}), "accepted");
}

TEST_F(MujocoPlant, RefusesWhatDoesNotFit) {
  write("other.xml",
        "<mujoco><worldbody><body><joint name='a'/><geom size='1'/></body></worldbody>"
        "</mujoco>");
  EXPECT_THAT(refusal({"plant.mujoco.model=other.xml"}), HasSubstr("no joint \"yaw\""));
  EXPECT_THAT(refusal({"plant.mujoco.model=none.xml"}), HasSubstr("none.xml"));
  write("newer.xml", "<mujoco><option integrator='newest'/></mujoco>");
  EXPECT_THAT(refusal({"plant.mujoco.model=newer.xml"}),
              AllOf(HasSubstr("newest"), HasSubstr("; this is MuJoCo "), HasSubstr("leave out")));
  EXPECT_THAT(refusal({"plant.mujoco.model=arm.xml", "plant.mujoco.keyframe=home"}),
              HasSubstr("no keyframe \"home\""));
  EXPECT_THAT(refusal({"plant.mujoco.model=arm.xml", "plant.payload.mass_kg=1"}),
              HasSubstr("a simulator has its own mechanics"));
  setenv("TACHLESS_MUJOCO", "/none/mujoco.so", 1);
  EXPECT_THAT(refusal({"plant.mujoco.model=arm.xml"}), HasSubstr("no module for MuJoCo"));
}

TEST_F(MujocoPlant, SticksByTheSolverParametersOfThePage) {
  // Gravity pulls with 9 N m against 40 N m of dry friction.
  const auto creep = [&](const std::string& parameters) {
    std::string model = two_links;
    model.insert(model.find("<worldbody>"),
                 "<default><joint frictionloss=\"40\" " + parameters + "/></default>");
    write("arm.xml", model);
    const auto scenario = scenario::load_scenario(
        directory_ / "arm.yaml",
        {"plant.mujoco={model: arm.xml, integrator: rk4}", "plant.initial={}",
         "controller.gains={kp: 100, kd: 10, a: 100, b: 100}",
         "reference={hold: {position_rad: [0, 0]}}"});
    const auto simulator = mujoco_simulator(scenario, plant_model(scenario));
    const Vector start = Eigen::Vector2d(0.7, -0.4);
    simulator->reset({start, Vector::Zero(2), {}, {}});
    for (int k = 1; k <= 2000; ++k) simulator->advance(Vector::Zero(2), 0.001 * k);
    return (simulator->state().q - start).cwiseAbs().maxCoeff();
  };
  EXPECT_GT(creep(""), 1e-4);
  EXPECT_LT(creep(R"(solreffriction=".002 1" solimpfriction=".9999 .9999 .001")"), 1e-5);
}

/// The largest deviation from the reference in the last twentieth of a run at this part of the
/// limit of the certificate, over the deviation at the start.
double growth(const std::filesystem::path& file, double part) {
  constexpr double apart = 1e-6;
  constexpr int ticks = 8000;
  scenario::Scenario scenario =
      scenario::load_scenario(file, {"plant.mujoco={model: arm.xml, integrator: rk4}",
                                     "plant.initial={torque: hold}", "plant.on_limit=warn"});
  const auto& hold = std::get<reference::trajectory::Hold>(scenario.reference);
  const auto limit_s = certify::analyse(scenario, linear::Effort::quick).limit_s;
  scenario.loop.period_s = part * limit_s.value();
  scenario.loop.num_ticks = ticks;
  scenario.loop.duration_s = ticks * scenario.loop.period_s;
  scenario.plant.initial.position_rad =
      hold.position_rad + Vector::Constant(scenario.num_joints, apart);
  double last = 0;
  try {
    in_process::run_in_process(scenario, [&](const TickRecord& record) {
      if (record.tick >= ticks - ticks / 20) {
        last = std::max(last, (record.truth.q - hold.position_rad).cwiseAbs().maxCoeff());
      }
      return true;
    });
  } catch (const base::Failure&) {
    return infinity;
  }
  return last / apart;
}

TEST_F(MujocoPlant, BehavesAsTheCertificatesLimitSays) {
  for (const std::string& model : {std::string(two_links), arm(), seven_joints()}) {
    write("arm.xml", model);
    const auto n = model == two_links ? 2 : model == arm() ? 3 : 7;
    std::string text = "name: limit\nrobot: {name: arm, urdf: arm.xml, joints: rigid}\n";
    std::vector<double> q, kp, kd;
    for (int i = 0; i < n; ++i) {
      q.push_back(0.3 + 0.1 * i);
      kp.push_back(300.0 / (1 + i));
      kd.push_back(30.0 / (1 + i));
    }
    text += fmt::format(
        "reference: {{hold: {{position_rad: [{}]}}}}\n"
        "controller:\n  law: loria_ortega_rigid\n"
        "  gains: {{kp: [{}], kd: [{}], a: 200, b: 200}}\n  filter: tustin\n"
        "loop: {{mode: lockstep, period_s: 0.001, duration_s: 1, command_delay: 1}}\n",
        fmt::join(q, ", "), fmt::join(kp, ", "), fmt::join(kd, ", "));
    write("limit.yaml", text);
    EXPECT_LT(growth(directory_ / "limit.yaml", 0.98), 0.5) << model;
    EXPECT_GT(growth(directory_ / "limit.yaml", 1.02), 100) << model;
  }
}

// The log is of a scenario that knows neither armature nor damping of the model.
TEST_F(MujocoPlant, HasArmatureAndDampingThatIdentifyFinds) {
  write("known.xml", arm("", "2", R"(armature="0" damping="0")"));
  const auto scenario = scenario::load_scenario(
      directory_ / "arm.yaml",
      {"robot.urdf=known.xml", "plant.mujoco={model: arm.xml, integrator: rk4, may_differ: true}",
       "reference={multi_sine: {offset_rad: [0, 0.3, 0.5], terms: [{amplitude_rad: 0.4, "
       "frequency_hz: [0.5, 0.6, 0.7]}, {amplitude_rad: 0.1, frequency_hz: [1.5, 1.7, 1.9]}]}}",
       "plant.encoder.resolution_bits=20", "loop.duration_s=5"});
  identify::Recording recording{"a run", scenario, Eigen::MatrixXd(5000, 3),
                                Eigen::MatrixXd(5000, 3)};
  in_process::run_in_process(scenario, [&](const TickRecord& tick) {
    recording.q.row(tick.tick) = messages::links_of(tick.measurement).transpose();
    recording.tau.row(tick.tick) = tick.applied.tau.transpose();
    return true;
  });
  using identify::Kind;
  const auto found = identify::identify({recording}, {Kind::rotor, Kind::viscous}, {},
                                        [](std::string_view /*what*/) {});
  ASSERT_EQ(found.parameters.size(), 6U);
  for (const auto& each : found.parameters) {
    const double truth = each.entry.kind == Kind::rotor ? 0.05 : 0.2;
    EXPECT_LE(std::abs(each.value - truth), each.half_width) << each.entry.name;
    EXPECT_LT(each.half_width, 0.05 * truth) << each.entry.name;
  }
}

TEST_F(MujocoPlant, ThatStartsAgainIsTheModelOfItsDigest) {
  const auto model = [&](const std::string& given) {
    return scenario::load_scenario(directory_ / "arm.yaml", {"plant.mujoco.model=" + given})
        .plant.mujoco.model;
  };
  const std::string pinned = model("arm.xml");
  EXPECT_THAT(pinned, ::testing::MatchesRegex("arm\\.xml@[0-9a-f]{16}"));
  EXPECT_EQ(model(pinned), pinned);
  EXPECT_EQ(refusal({"plant.mujoco.model=" + pinned}), "accepted");
  write("arm.xml", arm("", "2.5"));
  EXPECT_THAT(refusal({"plant.mujoco.model=" + pinned}),
              AllOf(HasSubstr("the file is another model, arm.xml@"), HasSubstr("or arm.xml")));
  // Included files count too.
  write("all.xml", "<mujoco><include file=\"arm.xml\"/></mujoco>");
  const std::string all = model("all.xml");
  write("arm.xml", arm());
  EXPECT_NE(model("all.xml"), all);
  // An include in a comment is none.
  write("all.xml", "<mujoco><!-- <include file=\"gone.xml\"/> --></mujoco>");
  EXPECT_THAT(model("all.xml"), ::testing::MatchesRegex("all\\.xml@[0-9a-f]{16}"));
}

TEST_F(MujocoPlant, ThatRunsAwayEndsTheRun) {
  EXPECT_THAT(refusal({"plant.mujoco.model=arm.xml", "controller.gains.kp=1e9",
                       "controller.gains.kd=1e7", "plant.on_limit=warn"}),
              HasSubstr("at tick"));
}

}  // namespace
}  // namespace tachless::plant
