#include "certificate/lyapunov.h"

#include <memory>
#include <type_traits>

#include "controller/laws.h"
#include "controller/registry.h"

namespace tachless::certificate {
namespace {

template <class L>
std::optional<LyapunovFunction> function_of(const experiment::Scenario& scenario,
                                            const Weights& weights) {
  if constexpr (controller::law::HasLyapunovFunction<L>) {
    const auto law = std::make_shared<const L>(controller::make_law<L>(scenario));
    return LyapunovFunction{
        std::string(L::lyapunov_formula),
        [law, weights](const LoopState& state, const loop::ReferencePoint& reference) {
          return law->lyapunov(state, reference, weights);
        }};
  } else {
    return {};
  }
}

}  // namespace

std::optional<LyapunovFunction> lyapunov_function(const experiment::Scenario& scenario,
                                                  const Weights& weights) {
  std::optional<LyapunovFunction> function;
  const auto look_up = [&]<class... L>(controller::LawList<L...> /*laws*/) {
    const auto take = [&]<class Law>(std::type_identity<Law> /*law*/) {
      if (scenario.controller.law == Law::name) function = function_of<Law>(scenario, weights);
    };
    (take(std::type_identity<L>{}), ...);
  };
  look_up(controller::Laws{});
  return function;
}

}  // namespace tachless::certificate
