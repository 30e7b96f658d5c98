#include "identify/output_error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <utility>

#include "base/failure.h"
#include "base/parallel.h"
#include "controller/registry.h"
#include "identify/compensating_arm.h"
#include "identify/physical_inertia.h"
#include "in_process/in_process_loop.h"
#include "numerics/decompositions.h"

namespace tachless::identify {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr int most_iterations = 30;
/// Share of an interval's half width; smaller steps mean convergence.
constexpr double good_step = 0.02;

/// Frequency above which the residual is the encoders' noise. It is above the loop's bandwidth,
/// because the simulated loop must not answer to this noise by a motion that changes the residual.
constexpr double noise_hz = 50;
/// Passes in which the noise is estimated anew. It then stays, so that the fit can converge.
constexpr int noise_passes = 3;

/// A law whose measured positions have an error.
class LawWithNoise final : public controller::AnyLaw {
 public:
  LawWithNoise(controller::ScenarioLaw law, const scenario::LoopSpec& loop, const MatrixXd& noise)
      : AnyLaw(loop), law_(std::move(law)), noise_(noise) {}

  [[nodiscard]] std::string_view name() const override { return law_->name(); }
  [[nodiscard]] std::string_view measurement() const override { return law_->measurement(); }
  [[nodiscard]] std::span<const messages::Signal> signals() const override {
    return law_->signals();
  }

 private:
  void compute(std::int64_t tick, const messages::AnyMeasurement& measurement,
               const messages::ReferencePoint& reference, int /*ticks*/) override {
    messages::AnyMeasurement read = measurement;
    if (Vector* const q = messages::parts_of(read)[0]) *q += noise_.row(tick).transpose();
    const controller::Outcome step = law_->step(tick, read, reference);
    command_ = step.command;
    signals_of_step_ = step.signals;
  }
  void build(std::string_view /*gains*/) override {}  // the law does it itself

  controller::ScenarioLaw law_;
  const MatrixXd& noise_;
};

/// The residuals of all recordings as one column vector, tick by tick.
using Residual = VectorXd;

class Problem {
 public:
  /// @param noise of each recording's encoders
  Problem(const std::vector<Recording>& recordings, const Parameters& parameters,
          std::vector<MatrixXd> noise)
      : recordings_(recordings), parameters_(parameters), noise_(std::move(noise)) {}

  /// Returns the residual, or nothing (size 0) when a simulated run ends early.
  /// @param values of the parameters, and then the v_r that are unknown
  [[nodiscard]] Residual residual(const VectorXd& values) const {
    Parameters moved = parameters_;
    moved.set_velocities(values.tail(moved.num_turning()));
    const VectorXd own = values.head(moved.size());
    std::vector<MatrixXd> parts;
    Eigen::Index rows = 0;
    for (std::size_t i = 0; i < recordings_.size(); ++i) {
      parts.push_back(simulated_residual(recordings_[i], moved, own, noise_[i]));
      if (parts.back().rows() < recordings_[i].num_ticks()) return {};
      rows += parts.back().size();
    }
    Residual all(rows);
    Eigen::Index at = 0;
    for (const MatrixXd& part : parts) {
      const MatrixXd by_tick = part.transpose();
      all.segment(at, part.size()) = by_tick.reshaped();
      at += part.size();
    }
    return all;
  }

  /// Takes what the filter removes from the residual as the recorded encoders' noise.
  void set_noise(const Residual& residual) {
    Eigen::Index at = 0;
    for (std::size_t i = 0; i < recordings_.size(); ++i) {
      const MatrixXd& q = recordings_[i].q;
      const MatrixXd part = residual.segment(at, q.size()).reshaped(q.cols(), q.rows()).transpose();
      noise_[i] = part - low_passed(part, recordings_[i].scenario.loop.period_s, noise_hz);
      at += part.size();
    }
  }
  [[nodiscard]] const std::vector<MatrixXd>& noise() const { return noise_; }

  /// Returns the root mean square per joint.
  [[nodiscard]] VectorXd spread(const Residual& residual) const {
    const Eigen::Index n = recordings_.front().q.cols(), ticks = residual.size() / n;
    return residual.reshaped(n, ticks).rowwise().norm() / std::sqrt(static_cast<double>(ticks));
  }

  /// Returns the Jacobian by differences, with one simulation per parameter.
  [[nodiscard]] MatrixXd jacobian(const VectorXd& values, const Residual& here,
                                  const VectorXd& steps) const {
    MatrixXd result(here.size(), values.size());
    base::parallel_for(static_cast<std::size_t>(values.size()), [&](std::size_t i) {
      const auto at = static_cast<Eigen::Index>(i);
      VectorXd moved = values;
      moved[at] += steps[at];
      const Residual there = residual(moved);
      if (there.size() == 0) {
        result.col(at).setZero();
      } else {
        result.col(at) = (there - here) / steps[at];
      }
    });
    return result;
  }

  /// Returns the change of the residual if the arms' own torques act as late as they may
  /// (`Recording::own_late`), a column; no column if that is known or the run then ends early.
  [[nodiscard]] MatrixXd change_by_own_torque(const VectorXd& values, const Residual& here) const {
    const auto is_known = [](const Recording& each) { return each.own_late == 0; };
    if (std::ranges::all_of(recordings_, is_known)) return {};
    std::vector<Recording> later = recordings_;
    for (Recording& each : later) each.own_late *= 2;
    const Residual there = Problem(later, parameters_, noise_).residual(values);
    if (there.size() == 0) return {};
    return there - here;
  }

 private:
  const std::vector<Recording>& recordings_;
  const Parameters& parameters_;
  std::vector<MatrixXd> noise_;
};

/// Derivatives of the residual, which later passes use again while their steps fall.
struct Derivatives {
  MatrixXd columns;             ///< empty: to be computed
  VectorXd at{}, steps{};       ///< values where they were computed, and the steps of it
  double last_step = infinity;  ///< largest one in half widths, of the pass before

  [[nodiscard]] bool is_empty() const { return columns.size() == 0; }

  /// Returns whether a pass with them, whose largest step is `step` half widths, did not come so
  /// much nearer as one with new derivatives would.
  [[nodiscard]] bool are_slow(double step) {
    constexpr double least_fall = 0.25;
    return step > least_fall * std::exchange(last_step, step);
  }

  /// Returns whether values are farther away than the steps of a few differences and than their
  /// half widths, or a v_r than its step.
  [[nodiscard]] bool are_far_from(const VectorXd& values, const VectorXd& half_width) const {
    constexpr double few = 10;
    const Eigen::Index size = half_width.size(), rises = values.size() - size;
    const VectorXd moved = (values - at).cwiseAbs();
    const VectorXd near = (few * steps.head(size)).cwiseMax(half_width);
    return (moved.head(size).array() > near.array()).any() ||
           (moved.tail(rises).array() > steps.tail(rises).array()).any();
  }
};

/// Returns the residual of a simulation that ran to its end.
Residual runs(Residual residual) {
  if (residual.size() > 0) return residual;
  throw base::Failure(base::ExitCode::check_said_no,
                      "the loop with the parameters of least squares does not run to its end in "
                      "simulation; nothing is identified");
}

/// Divides each row by its joint's spread.
template <class Matrix>
Matrix weighted(Matrix rows, const VectorXd& spread) {
  for (Eigen::Index row = 0; row < rows.rows(); ++row) rows.row(row) /= spread[row % spread.size()];
  return rows;
}

/// Returns a step of each parameter and v_r that the simulation resolves. It is a share of the
/// parameter's value or `scale`; for link parameters it depends on the link. A delay's step is 0.1
/// tick.
VectorXd difference_steps(const VectorXd& values, const VectorXd& scale,
                          const Parameters& parameters, const robot::Model& model) {
  VectorXd steps = (1e-3 * values.cwiseAbs()).cwiseMax(1e-3 * scale);
  steps.tail(parameters.num_turning()) *= 10;
  for (Eigen::Index i = 0; i < parameters.size(); ++i) {
    const Parameters::Entry& entry = parameters.entries()[static_cast<std::size_t>(i)];
    if (entry.kind == Kind::delay) steps[i] = 0.1;
    if (entry.kind != Kind::inertia && entry.kind != Kind::load) continue;
    constexpr double length = 0.1;
    const double mass =
        entry.kind == Kind::load
            ? 1
            : std::max(0.1, model.bodies[static_cast<std::size_t>(entry.joint)].mass);
    steps[i] = 1e-3 * mass *
               (entry.component == 0  ? 1
                : entry.component < 4 ? length
                                      : length * length);
  }
  return steps;
}

/// Changes further terms of friction to those that take energy at every speed, as a plant demands.
void keep_energy(const Parameters& parameters, VectorXd& values) {
  constexpr double least_coulomb = 1e-6;  // [N m; N] where friction grows with the load
  const Eigen::Index coulomb = parameters.first(Kind::coulomb);
  for (Eigen::Index i = 0; coulomb >= 0 && i < parameters.size(); ++i) {
    const Parameters::Entry& entry = parameters.entries()[static_cast<std::size_t>(i)];
    if (!is_term(entry.kind)) continue;
    double& dry = values[coulomb + entry.joint];
    if (entry.kind == Kind::rise) {
      values[i] = std::max(values[i], -dry);
    } else {
      values[i] = std::clamp(values[i], 0.0, 1.0);
      dry = std::max(dry, least_coulomb);
    }
  }
}

/// Returns the values of the linear problem J x = y that are possible, and then the v_r, which
/// change by a factor of two at most.
/// @param here values and v_r at which J was computed
PossibleValues possible_step(const MatrixXd& J, const VectorXd& y, const VectorXd& here,
                             const Parameters& parameters, const robot::Model& model) {
  const Eigen::Index size = parameters.size(), rises = parameters.num_turning();
  const MatrixXd N = J.transpose() * J;
  const VectorXd b = J.transpose() * y;
  if (rises == 0) {
    PossibleValues result = possible_values(N, b, parameters, model);
    keep_energy(parameters, result.values);
    return result;
  }
  MatrixXd turns = N.bottomRightCorner(rises, rises);
  turns.diagonal() *= 1 + 1e-9;
  turns.diagonal().array() += 1e-300;
  const MatrixXd inverse = numerics::inverse(turns), both = N.topRightCorner(size, rises),
                 own = N.topLeftCorner(size, size);
  PossibleValues result =
      possible_values(own - both * inverse * both.transpose(),
                      b.head(size) - both * inverse * b.tail(rises), parameters, model);
  const VectorXd from = here.tail(rises);
  const VectorXd next = (inverse * (b.tail(rises) - both.transpose() * result.values))
                            .cwiseMax(0.5 * from)
                            .cwiseMin(2 * from);
  result = possible_values(own, b.head(size) - both * next, parameters, model);
  keep_energy(parameters, result.values);
  result.values.conservativeResize(size + rises);
  result.values.tail(rises) = next;
  return result;
}

/// Returns the rows of `rows_of_fit`.
/// @param all rows of all ticks
MatrixXd thinned_rows(const MatrixXd& all, Eigen::Index joints) {
  constexpr Eigen::Index most_ticks = 6000;
  const Eigen::Index ticks = all.rows() / joints, step = (ticks + most_ticks - 1) / most_ticks;
  MatrixXd result(joints * (ticks / step), all.cols());
  for (Eigen::Index k = 0; k < ticks / step; ++k) {
    result.middleRows(joints * k, joints) = all.middleRows(joints * k * step, joints);
  }
  return result;
}

}  // namespace

VectorXd rows_of_fit(const std::vector<Recording>& recordings, const Parameters& parameters,
                     const VectorXd& values, const Fit& fit) {
  const Residual all = Problem(recordings, parameters, fit.noise).residual(values);
  if (all.size() == 0) return fit.r;
  return thinned_rows(weighted(all, fit.residual), fit.residual.size());
}

MatrixXd simulated_residual(const Recording& recording, const Parameters& parameters,
                            const VectorXd& values, const MatrixXd& noise) {
  const scenario::Scenario plant = parameters.plant(
      recording.scenario, recording.loaded ? values : parameters.without_load(values));
  controller::ScenarioLaw law = controller::scenario_law(recording.scenario);
  if (noise.size() > 0) {
    law = std::make_unique<LawWithNoise>(std::move(law), recording.scenario.loop, noise);
  }
  MatrixXd result(recording.num_ticks(), recording.q.cols());
  Eigen::Index done = 0;
  const auto on_tick = [&](const in_process::TickRecord& record) {
    if (const auto* const q = messages::parts_of(record.measurement)[0]) {
      result.row(done) = recording.q.row(done) - q->transpose();
    }
    return ++done < recording.num_ticks();
  };
  try {
    if (recording.own.size() > 0) {
      CompensatingArm arm(plant, recording.scenario, recording.own_late);
      in_process::run_in_process(without_mechanics(plant), std::move(law), on_tick, arm);
    } else {
      in_process::run_in_process(plant, std::move(law), on_tick);
    }
  } catch (const base::Failure& failure) {
    if (failure.code() != base::ExitCode::protective_stop) throw;
  }
  return result.topRows(done);
}

Fit output_error(const std::vector<Recording>& recordings, const Parameters& parameters,
                 const VectorXd& start, const Report& report) {
  const Eigen::Index size = parameters.size(), rises = parameters.num_turning();
  Problem problem(recordings, parameters, std::vector<MatrixXd>(recordings.size()));
  Fit fit;
  VectorXd at(size + rises);
  at << start, parameters.velocities();
  Residual here = runs(problem.residual(at));
  // Scale of a parameter: its start value, or a thousandth of the largest start value if that is
  // more.
  VectorXd scale = at.cwiseAbs().cwiseMax(1e-3 * std::max(1e-3, start.cwiseAbs().maxCoeff()));
  scale.tail(rises) = at.tail(rises);
  const robot::Model& model = *recordings.front().scenario.model;
  Derivatives derivatives;
  VectorXd left;
  bool done = false;
  for (int iteration = 0; iteration < most_iterations && !done; ++iteration) {
    const bool anew = derivatives.is_empty();
    report(fmt::format("simulating {}, pass {} of at most {}",
                       anew ? fmt::format("{} loops", at.size() + 1) : "a loop", iteration + 1,
                       most_iterations));
    if (iteration < noise_passes) {
      problem.set_noise(here);
      here = runs(problem.residual(at));
    }
    const VectorXd spread = problem.spread(here).cwiseMax(1e-12);
    if (anew) {
      const VectorXd steps = difference_steps(at, scale, parameters, model);
      derivatives = {problem.jacobian(at, here, steps), at, steps};
    }
    const MatrixXd J = weighted(derivatives.columns, spread);
    const Residual r = weighted(here, spread);
    const PossibleValues next = possible_step(J, J * at - r, at, parameters, model);
    static_cast<Precision&>(fit) =
        precision_of_first(size, J, r, at_bound(parameters, at.head(size)), {next.prior},
                           weighted(problem.change_by_own_torque(at, here), spread));
    fit.residual = spread;
    fit.noise = problem.noise();
    const VectorXd step = next.values - at;
    left = step.head(size).cwiseAbs();
    double best = r.squaredNorm(), shrink = 1;
    bool moved = false;
    for (int attempt = 0; attempt < (anew ? 6 : 2) && !moved; ++attempt, shrink /= 3) {
      const VectorXd candidate = at + shrink * step;
      const Residual there = problem.residual(candidate);
      if (there.size() == 0 || weighted(there, spread).squaredNorm() >= best) continue;
      best = weighted(there, spread).squaredNorm();
      const VectorXd change = (candidate - at).head(size);
      at = candidate;
      here = there;
      moved = true;
      done = (change.cwiseAbs().array() <= good_step * fit.half_width.array()).all();
    }
    fit.J = thinned_rows(J, spread.size());
    if (!moved && anew) break;
    const bool slow =
        derivatives.are_slow((left.array() / fit.half_width.cwiseMax(1e-300).array()).maxCoeff());
    if (!anew && (!moved || (done ? derivatives.are_far_from(at, fit.half_width) : slow))) {
      derivatives = {};
      done = false;
    }
  }
  fit.values = at.head(size);
  fit.velocities = at.tail(rises);
  fit.r = thinned_rows(weighted(here, fit.residual), fit.residual.size());
  if (!done) fit.half_width += left;  // the estimate would still change by this step
  return fit;
}

}  // namespace tachless::identify
