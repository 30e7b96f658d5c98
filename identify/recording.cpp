#include "identify/recording.h"

#include <cmath>
#include <cstdint>
#include <variant>
#include <vector>

#include "diagnostics/failure.h"
#include "logger/run_log.h"

namespace tachless::identify {
namespace {

using diagnostics::bad_usage;

constexpr double shortest_s = 2;
constexpr double most_saturated = 0.01;  ///< of the ticks

/// The positions of a measurement of the links; empty of one of the motors.
robot::Vector links(const loop::AnyMeasurement& measurement) {
  return std::visit(
      []<class M>(const M& measured) -> robot::Vector {
        if constexpr (loop::holds_links<M>) {
          return measured.q;
        } else {
          return {};
        }
      },
      measurement);
}

}  // namespace

void require_usable(const Recording& recording) {
  const double seconds =
      static_cast<double>(recording.num_ticks()) * recording.scenario.loop.period_s;
  if (seconds < shortest_s) {
    throw bad_usage("{}: {:.3g} s of positions and torques; at least {:g} s are needed",
                    recording.source, seconds, shortest_s);
  }
  const Eigen::RowVectorXd range =
      recording.q.colwise().maxCoeff() - recording.q.colwise().minCoeff();
  const robot::Vector count =
      experiment::encoder_count(recording.scenario, *recording.scenario.model);
  const double needed = std::max(0.02, count.size() > 0 ? 100 * count.maxCoeff() : 0.0);
  if (range.maxCoeff() >= needed) return;
  throw bad_usage(
      "{}: too little motion: no joint moves by more than {:.2g} rad (m), at least {:.2g} are "
      "needed; record a run whose reference moves every joint",
      recording.source, range.maxCoeff(), needed);
}

Recording read_recording(const std::filesystem::path& log) {
  logger::RunLog run = logger::RunLog::open(log);
  Recording result{log.string(), run.scenario(), {}, {}};
  if (result.scenario.robot.flexible) {
    throw bad_usage("{}: a robot with flexible joints; identify is for rigid ones", result.source);
  }
  const Eigen::Index n = result.scenario.num_joints;
  std::vector<double> q, tau;
  std::int64_t saturated = 0, missed = 0, ticks = 0;
  logger::TickRecord record;
  while (run.next(record)) {
    if (!record.measurement || !record.truth) continue;
    const robot::Vector positions = links(*record.measurement);
    if (positions.size() != n) {
      throw bad_usage("{}: holds no positions of the joints (links)", result.source);
    }
    q.insert(q.end(), positions.begin(), positions.end());
    tau.insert(tau.end(), record.truth->tau.begin(), record.truth->tau.end());
    bool at_limit = false;
    for (Eigen::Index i = 0; i < n; ++i) {
      at_limit = at_limit || record.truth->saturated[static_cast<std::size_t>(i)];
    }
    saturated += at_limit ? 1 : 0;
    missed += record.truth->fault == loop::truth::DriveFault::command_missed ? 1 : 0;
    ++ticks;
  }
  if (const std::uint64_t gaps = run.summary().gaps(); gaps > 0 || missed > 0) {
    throw bad_usage("{}: {} messages of ticks and {} commands are missing; record the run again",
                    result.source, gaps, missed);
  }
  if (static_cast<double>(saturated) > most_saturated * static_cast<double>(ticks)) {
    throw bad_usage("{}: a torque was at its limit in {} of {} ticks; record a slower motion",
                    result.source, saturated, ticks);
  }
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  result.q = Eigen::Map<const Rows>(q.data(), ticks, n);
  result.tau = Eigen::Map<const Rows>(tau.data(), ticks, n);
  require_usable(result);
  return result;
}

void require_same_robot(const Recording& first, const Recording& other) {
  const experiment::RobotSpec &a = first.scenario.robot, &b = other.scenario.robot;
  if (a.urdf_text == b.urdf_text && a.locked == b.locked && a.base.rpy == b.base.rpy &&
      a.gravity_m_per_s2 == b.gravity_m_per_s2) {
    return;
  }
  throw bad_usage("{}: is of another robot than {}: URDF, locked joints, base or gravity differ",
                  other.source, first.source);
}

}  // namespace tachless::identify
