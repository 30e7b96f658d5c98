#include "certificate/lyapunov.h"

#include <memory>
#include <type_traits>

#include "controller/laws.h"
#include "controller/registry.h"

namespace tachless::certificate {
namespace {

template <class L>
std::optional<LyapunovFunction> function_of(const experiment::Scenario& scenario) {
  if constexpr (controller::law::HasLyapunovFunction<L>) {
    const auto law = std::make_shared<const L>(controller::make_law<L>(scenario));
    const auto certified = certified_run(scenario);
    const Weights weights = certified ? certified->weights : Weights();
    return LyapunovFunction{
        std::string(L::lyapunov_formula), certified,
        [law, weights](const LoopState& state, const loop::ReferencePoint& reference) {
          return law->lyapunov(state, reference, weights);
        }};
  } else {
    return {};
  }
}

}  // namespace

std::optional<LyapunovFunction> lyapunov_function(const experiment::Scenario& scenario) {
  std::optional<LyapunovFunction> function;
  const auto look_up = [&]<class... L>(controller::LawList<L...> /*laws*/) {
    const auto take = [&]<class Law>(std::type_identity<Law> /*law*/) {
      if (scenario.controller.law == Law::name) function = function_of<Law>(scenario);
    };
    (take(std::type_identity<L>{}), ...);
  };
  look_up(controller::Laws{});
  return function;
}

}  // namespace tachless::certificate
