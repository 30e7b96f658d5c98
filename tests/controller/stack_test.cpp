#include <fmt/format.h>
#include <gtest/gtest.h>
#include <pthread.h>

#include <algorithm>
#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "controller/registry.h"
#include "design/design.h"
#include "messages/measurements.h"

namespace tachless::controller {
namespace {

/// Returns how many bytes of stack a function uses beyond those of an empty function.
std::size_t stack_of(const std::function<void()>& function) {
  const auto used = [](const std::function<void()>& called) {
    constexpr char untouched = 0x5a;
    static std::vector<char> memory(1 << 20);
    std::fill(memory.begin(), memory.end(), untouched);
    pthread_attr_t attributes;
    pthread_attr_init(&attributes);
    EXPECT_EQ(pthread_attr_setstack(&attributes, memory.data(), memory.size()), 0);
    const auto run = [](void* argument) -> void* {
      (*static_cast<const std::function<void()>*>(argument))();
      return nullptr;
    };
    pthread_t thread{};
    EXPECT_EQ(pthread_create(&thread, &attributes, run,
                             const_cast<void*>(static_cast<const void*>(&called))),
              0);
    pthread_join(thread, nullptr);
    pthread_attr_destroy(&attributes);
    // A stack grows downward.
    const auto first =
        std::find_if(memory.begin(), memory.end(), [](char c) { return c != untouched; });
    return static_cast<std::size_t>(memory.end() - first);
  };
  const std::size_t empty = used([] {});
  return used(function) - empty;
}

/// A thread of a caller's own loop may have a small stack. docs/use_law.md states these sizes.
TEST(Stack, OfAStepOfALawIsThatOfItsRobot) {
  const auto most_bytes = [](std::string_view law) {
    if (law == "loria_ortega_rigid") return std::size_t{24 * 1024};
    if (law == "loria_ortega_flexible") return std::size_t{80 * 1024};
    return std::size_t{112 * 1024};
  };
  for (const LawFacts& facts : laws()) {
    SCOPED_TRACE(facts.name);
    const std::string file = facts.needs_flexible_joints ? "iiwa_flexible" : "iiwa_point_to_point";
    std::vector<std::string> overrides = {fmt::format("controller.law={}", facts.name),
                                          "controller.gains={}"};
    if (facts.needs_flexible_joints) overrides.emplace_back("plant.encoder.side=both");
    if (facts.regulation_only)
      overrides.emplace_back("reference={hold: {position_rad: [0, 0, 0, 0, 0, 0, 0]}}");
    const std::string path = fmt::format("{}/scenarios/{}.yaml", TACHLESS_SOURCE_DIR, file);
    scenario::Scenario scenario = scenario::load_scenario(path, overrides);
    scenario.controller.gains = design::rule_of_thumb(scenario, 5).gains;
    const ScenarioLaw law = scenario_law(scenario);
    const Vector q = Vector::Constant(7, 0.1);
    messages::AnyMeasurement measured = *messages::measurement_of(facts.measurement);
    for (Vector* part : messages::parts_of(measured)) {
      if (part != nullptr) *part = q;
    }
    const messages::ReferencePoint reference{q, q, q, q, q};
    const std::size_t bytes = stack_of([&] {
      for (int tick = 0; tick < 2; ++tick) (void)law->step(tick, measured, reference);
    });
    EXPECT_LT(bytes, most_bytes(facts.name));
  }
}

}  // namespace
}  // namespace tachless::controller
