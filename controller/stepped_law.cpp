#include "controller/stepped_law.h"

#include <type_traits>

#include "controller/laws.h"
#include "controller/registry.h"

namespace tachless::controller {
namespace {

using Eigen::VectorXd;
using messages::ReferencePoint;

/// Returns pointers to the vectors of a law's memory.
template <class Memory>
std::vector<Vector*> vectors_of(Memory& memory) {
  std::vector<Vector*> all;
  law::for_each_vector(memory, [&](Vector& x) { all.push_back(&x); });
  return all;
}

template <class L>
SteppedLaw stepped(const L& law, const ReferencePoint& reference,
                   const std::array<Vector, 4>& state) {
  typename L::Measurement nominal;
  SteppedLaw result;
  const auto parts = messages::parts_of(nominal);
  result.measured = measure(state, parts);
  // The nominal memory is that after a step. A start memory lacks values known only from an earlier
  // step, such as the last torque command.
  auto memory = law.step(law.start(nominal, reference), nominal, reference).memory;
  result.memory = packed(vectors_of(memory));
  result.measurement = packed(parts);
  result.start = [=](const VectorXd& measurement_in) {
    typename L::Measurement own = nominal;
    unpack(measurement_in, messages::parts_of(own));
    auto first = law.start(own, reference);
    return packed(vectors_of(first));
  };
  result.step = [=](const VectorXd& memory_in, const VectorXd& measurement_in) {
    auto before = memory;
    typename L::Measurement own = nominal;
    unpack(memory_in, vectors_of(before));
    unpack(measurement_in, messages::parts_of(own));
    auto next = law.step(before, own, reference);
    return std::pair<VectorXd, VectorXd>(packed(vectors_of(next.memory)), next.command.tau);
  };
  return result;
}

}  // namespace

VectorXd packed(std::span<Vector* const> vectors) {
  std::vector<double> all;
  for (const Vector* x : vectors) {
    if (x != nullptr) all.insert(all.end(), x->begin(), x->end());
  }
  return Eigen::Map<const VectorXd>(all.data(), static_cast<Eigen::Index>(all.size()));
}

void unpack(const VectorXd& from, std::span<Vector* const> vectors) {
  Eigen::Index begin = 0;
  for (Vector* x : vectors) {
    if (x == nullptr) continue;
    *x = from.segment(begin, x->size());
    begin += x->size();
  }
}

std::vector<messages::Part> measure(const std::array<Vector, 4>& state,
                                    std::span<Vector* const> parts) {
  std::vector<messages::Part> measured;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (parts[i] == nullptr) continue;
    *parts[i] = state[i];
    if (state[i].size() > 0) measured.push_back(static_cast<messages::Part>(i));
  }
  return measured;
}

SteppedLaw stepped_law(const scenario::Scenario& scenario, const ReferencePoint& reference,
                       const std::array<Vector, 4>& state) {
  SteppedLaw result;
  with_law(scenario.controller.law, [&]<class L>(std::type_identity<L> /*type*/) {
    if constexpr (law::MadeOfVectors<typename L::Memory>) {
      result = stepped(make_law<L>(scenario), reference, state);
    }
  });
  return result;
}

LyapunovFunction lyapunov_function(const scenario::Scenario& scenario,
                                   const law::LyapunovWeights& weights) {
  LyapunovFunction function;
  with_law(scenario.controller.law, [&]<class L>(std::type_identity<L> /*type*/) {
    if constexpr (law::HasLyapunovFunction<L>) {
      function = [law = make_law<L>(scenario), weights](const law::LoopState& state,
                                                        const ReferencePoint& reference) {
        return law.lyapunov(state, reference, weights);
      };
    }
  });
  return function;
}

}  // namespace tachless::controller
