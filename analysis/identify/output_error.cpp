#include "identify/output_error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>

#include "base/failure.h"
#include "base/parallel.h"
#include "controller/registry.h"
#include "identify/physical_inertia.h"
#include "in_process/in_process_loop.h"

namespace tachless::identify {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

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
  Problem(const std::vector<Recording>& recordings, const Parameters& parameters)
      : recordings_(recordings), parameters_(parameters), noise_(recordings.size()) {}

  /// Returns the residual, or nothing (size 0) when a simulated run ends early.
  [[nodiscard]] Residual residual(const VectorXd& values) const {
    std::vector<MatrixXd> parts;
    Eigen::Index rows = 0;
    for (std::size_t i = 0; i < recordings_.size(); ++i) {
      parts.push_back(simulated_residual(recordings_[i], parameters_, values, noise_[i]));
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

 private:
  const std::vector<Recording>& recordings_;
  const Parameters& parameters_;
  std::vector<MatrixXd> noise_;
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

/// Returns a step of each parameter that the simulation resolves. It is a share of the parameter's
/// value or `scale`; for link parameters it depends on the link. A delay's step is 0.1 tick.
VectorXd difference_steps(const VectorXd& values, const VectorXd& scale,
                          const Parameters& parameters, const robot::Model& model) {
  VectorXd steps = (1e-3 * values.cwiseAbs()).cwiseMax(1e-3 * scale);
  for (Eigen::Index i = 0; i < steps.size(); ++i) {
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

}  // namespace

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
  try {
    in_process::run_in_process(plant, std::move(law), [&](const in_process::TickRecord& record) {
      if (const auto* const q = messages::parts_of(record.measurement)[0]) {
        result.row(done) = recording.q.row(done) - q->transpose();
      }
      return ++done < recording.num_ticks();
    });
  } catch (const base::Failure& failure) {
    if (failure.code() != base::ExitCode::protective_stop) throw;
  }
  return result.topRows(done);
}

Fit output_error(const std::vector<Recording>& recordings, const Parameters& parameters,
                 const VectorXd& start, const Report& report) {
  Problem problem(recordings, parameters);
  Fit fit;
  fit.values = start;
  Residual here = runs(problem.residual(fit.values));
  // Scale of a parameter: its start value, or a thousandth of the largest start value if that is
  // more.
  VectorXd scale = start.cwiseAbs().cwiseMax(1e-3 * std::max(1e-3, start.cwiseAbs().maxCoeff()));
  const robot::Model& model = *recordings.front().scenario.model;
  VectorXd left;
  for (int iteration = 0; iteration < most_iterations; ++iteration) {
    report(fmt::format("simulating {} loops, pass {} of at most {}", parameters.size() + 1,
                       iteration + 1, most_iterations));
    if (iteration < noise_passes) {
      problem.set_noise(here);
      here = runs(problem.residual(fit.values));
    }
    const VectorXd spread = problem.spread(here).cwiseMax(1e-12);
    const MatrixXd J = weighted(
        problem.jacobian(fit.values, here, difference_steps(fit.values, scale, parameters, model)),
        spread);
    const Residual r = weighted(here, spread);
    const PossibleValues next =
        possible_values(J.transpose() * J, J.transpose() * (J * fit.values - r), parameters, model);
    static_cast<Precision&>(fit) = precision(J, r, at_bound(parameters, fit.values), {next.prior});
    fit.residual = spread;
    fit.noise = problem.noise();
    const VectorXd step = next.values - fit.values;
    left = step.cwiseAbs();
    double best = r.squaredNorm(), shrink = 1;
    bool moved = false;
    for (int attempt = 0; attempt < 6 && !moved; ++attempt, shrink /= 3) {
      const VectorXd candidate = fit.values + shrink * step;
      const Residual there = problem.residual(candidate);
      if (there.size() == 0 || weighted(there, spread).squaredNorm() >= best) continue;
      best = weighted(there, spread).squaredNorm();
      const VectorXd change = candidate - fit.values;
      fit.values = candidate;
      here = there;
      moved = true;
      if ((change.cwiseAbs().array() <= good_step * fit.half_width.array()).all()) return fit;
    }
    if (!moved) break;
  }
  fit.half_width += left;  // no convergence: the estimate would still change by this step
  return fit;
}

}  // namespace tachless::identify
