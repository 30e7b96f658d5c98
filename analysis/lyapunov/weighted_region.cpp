#include "lyapunov/weighted_region.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "base/parallel.h"
#include "linear/linear_loop.h"
#include "lyapunov/law_loop.h"
#include "lyapunov/stability_certificate.h"

namespace tachless::lyapunov {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// All entries, those between joints too: 75 numbers for `flexible_position` with two joints.
FormEntries entries_of(Index states, Index joints) {
  FormEntries all;
  for (Index i = 0; i < states; ++i) {
    for (Index j = i; j < states; ++j) all.P.emplace_back(i, j);
    for (Index j = 0; j < joints; ++j) all.N.emplace_back(j, i);
  }
  return all;
}

std::vector<ErrorForm> forms_of(const FormLoop& loop, int count) {
  return base::parallel_map(static_cast<std::size_t>(count),
                            [&](std::size_t k) { return loop.form(static_cast<int>(k)); });
}

/// Searches weights over few forms, to which those that bind over many are added.
std::optional<FormWeights> searched(const FormLoop& loop, const std::vector<ErrorForm>& fine,
                                    FormRegion& best) {
  // Each round adds the form that binds. The search ends before where the few forms promise 0.95 of
  // the level that all of them give; the caps bound the time.
  constexpr int coarse_forms = 24, rounds = 8;
  constexpr double rate = 1;  // 1/s: without it V would be level between the forms
  std::vector<ErrorForm> coarse(fine.begin(), fine.begin() + coarse_forms);
  const Index states = fine[0].Fy.rows(), joints = fine[0].M.rows();
  const FormEntries entries = entries_of(states, joints);
  std::optional<FormWeights> found, result;
  for (int round = 0; round < rounds; ++round) {
    found = best_form_weights(coarse, entries, loop.size(), rate, found);
    if (!found) break;
    const FormRegion promised = region_of(coarse, *found), region = region_of(fine, *found);
    if (region.level > best.level) {
      best = region;
      result = found;
    }
    if (region.level > 0.95 * promised.level) break;
    coarse.push_back(fine[region.binding]);
  }
  return result;
}

/// Puts the region that is proved at every posture in the place of the sampled one, if there is
/// one.
void prove(WeightedRegion& result, const FormLoop& loop, const robot::Model& links) {
  const auto bounded = loop.bounded();
  if (!bounded || !(result.region.level > 0)) return;
  const numerics::Postures postures(links);
  if (!postures.proved) return;
  const FormRegion region = proved_region(*bounded, postures, result.weights);
  if (!(region.level > 0)) return;
  result.region = region;
  result.proved = true;
}

/// Returns V of x = (y, edot).
double value_at(const ErrorForm& form, const FormWeights& weights, const VectorXd& x) {
  return 0.5 * x.dot(lyapunov_matrix(form, weights) * x);
}

}  // namespace

std::optional<WeightedRegion> weighted_region(const scenario::Scenario& scenario,
                                              std::string& why_not,
                                              const linear::OnProgress& tell) {
  const std::unique_ptr<FormLoop> loop = form_loop(scenario, why_not);
  if (!loop) return {};
  constexpr int most_joints = 2;
  if (!loop->weights() && scenario.num_joints > most_joints) {
    why_not = "weights of V are searched for robots of one or two joints";
    return {};
  }
  tell("certified region: postures and instants");
  const int samples = scenario.num_joints <= 2 ? 500 : 200;
  const std::vector<ErrorForm> fine = forms_of(*loop, std::max(1, samples) * loop->corners());
  WeightedRegion result;
  result.forms = static_cast<int>(fine.size());
  tell("certified region: weights");
  if (const auto own = loop->weights()) {
    result.weights = *own;
    result.region = region_of(fine, *own);
  } else if (const auto found = searched(*loop, fine, result.region)) {
    result.weights = *found;
    tell("certified region: all postures");
    prove(result, *loop, error_model(scenario));
  }
  if (!(result.region.level > 0)) {
    why_not = loop->weights()
                  ? "V does not fall with the law's eps_1 and eps_2 at every corner of the box of "
                    "the unknown parameters; give smaller eps_1 and eps_2, or a smaller box"
                  : "no weights of V were found with which V falls at all sampled postures; give a "
                    "smaller kd1 b1 / K, or slower gains";
    return {};
  }
  result.of_parameters = loop->of_parameters();
  result.provisos = provisos(scenario, false);
  const VectorXd x0 = loop->initial();
  for (int corner = 0; corner < loop->corners(); ++corner) {
    // The first forms are those of the start, one at every corner.
    result.V0 =
        std::max(result.V0, value_at(fine[static_cast<std::size_t>(corner)], result.weights, x0));
  }
  const double left = result.region.level - result.of_parameters.value_or(0);
  const Index n = scenario.num_joints;
  result.e_at_rest = VectorXd::Zero(n);
  for (Index i = 0; i < n && left > 0; ++i) {
    const auto within = [&](double e) {
      const VectorXd y = loop->displaced(e * VectorXd::Unit(n, i));
      return 0.5 * y.dot(result.weights.P * y) <= left;
    };
    result.e_at_rest[i] = linear::edge(0, 1000, 40, within);
  }
  return result;
}

}  // namespace tachless::lyapunov
