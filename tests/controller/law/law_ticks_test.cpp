// Tests of the laws derived here against tests/golden/law_ticks.json: the torques of the first
// ticks, by another program with its own dynamics of the same URDFs.

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <type_traits>

#include "base/json_text.h"
#include "controller/law/flexible_motor.h"
#include "controller/law/flexible_position.h"
#include "controller/law/loria_ortega_adaptive.h"
#include "controller/law/loria_ortega_bounded.h"
#include "controller/law/loria_ortega_integral.h"
#include "tests/core/robot/robots.h"

namespace tachless::controller::law::law_ticks_test {
namespace {

using Json = nlohmann::json;

Vector vector_of(const Json& json, Eigen::Index size) {
  if (json.is_number()) return Vector::Constant(size, json.get<double>());
  Vector result(static_cast<Eigen::Index>(json.size()));
  for (Eigen::Index i = 0; i < result.size(); ++i) {
    result[i] = json[static_cast<std::size_t>(i)].get<double>();
  }
  return result;
}

/// Fills gains by the names of their keys. A gain that is absent keeps its default.
template <class Gains>
Gains gains_of(const Json& json, Eigen::Index n) {
  Gains gains;
  base::for_each_key<Gains>([&]<class Member>(const base::Key<Gains, Member>& key) {
    const auto given = json.find(std::string(key.name));
    if (given == json.end()) return;
    if constexpr (std::is_same_v<Member, Vector>) {
      gains.*key.member = vector_of(*given, n);
    } else {
      gains.*key.member = given->get<Member>();
    }
  });
  return gains;
}

template <class L>
L law_of(const Json& json, const robot::Model& model) {
  const Eigen::Index n = model.num_joints;
  Settings settings{json["period_s"].get<double>(), Discretisation::tustin, FilterStart::at_error,
                    json["feedforward_lead_s"].get<double>()};
  if (json["gains"].contains("torque_limit")) {
    settings.torque_limit = vector_of(json["gains"]["torque_limit"], n);
  }
  const auto gains = gains_of<typename L::Gains>(json["gains"], n);
  if constexpr (std::is_same_v<typename L::Robot, FlexibleRobot>) {
    return L({model, vector_of(json["stiffness"], n), vector_of(json["rotor_inertia"], n)}, gains,
             settings);
  } else {
    return L(model, gains, settings);
  }
}

template <class L>
class LawTicks : public testing::Test {};
using Laws = testing::Types<FlexibleMotor, FlexiblePosition, LoriaOrtegaAdaptive,
                            LoriaOrtegaBounded, LoriaOrtegaIntegral>;
TYPED_TEST_SUITE(LawTicks, Laws);

TYPED_TEST(LawTicks, GiveTheRecordedTorques) {
  using Measurement = typename TypeParam::Measurement;
  const std::string text =
      robot::testing::read_text(TACHLESS_SOURCE_DIR "/tests/golden/law_ticks.json");
  int cases = 0;
  for (const Json& json : base::parse_json(text)) {
    if (json["law"] != TypeParam::name) continue;
    ++cases;
    const robot::Model model =
        json["robot"] == "two_link" ? robot::testing::two_link() : robot::testing::iiwa7();
    const Eigen::Index n = model.num_joints;
    const TypeParam law = law_of<TypeParam>(json, model);
    typename TypeParam::Memory memory;
    bool first = true;
    for (const Json& tick : json["ticks"]) {
      const Json& r = tick["reference"];
      const ReferencePoint reference{vector_of(r[0], n), vector_of(r[1], n), vector_of(r[2], n),
                                     vector_of(r[3], n), vector_of(r[4], n)};
      Measurement measured;
      if constexpr (requires { measured.q; }) measured.q = vector_of(tick["q"], n);
      if constexpr (requires { measured.theta; }) measured.theta = vector_of(tick["theta"], n);
      if (first) memory = law.start(measured, reference);
      first = false;
      const auto step = law.step(memory, measured, reference);
      memory = step.memory;
      const Vector torque = vector_of(tick["torque"], n);
      // Both programs sum terms of up to the largest torque.
      ASSERT_LE((step.command.tau - torque).cwiseAbs().maxCoeff(),
                1e-12 * (1 + torque.cwiseAbs().maxCoeff()))
          << json["robot"];
      if constexpr (requires { step.memory.load; }) {
        EXPECT_NEAR(step.memory.load[0], tick["estimate"][0].template get<double>(), 1e-12);
      }
    }
  }
  EXPECT_GT(cases, 0);
}

}  // namespace
}  // namespace tachless::controller::law::law_ticks_test
