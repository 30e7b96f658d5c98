#include "identify/recording.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <iterator>
#include <utility>

#include "base/failure.h"
#include "identify/least_squares.h"
#include "plant/own_torque.h"

namespace tachless::identify {
namespace {

using base::bad_usage;

constexpr double shortest_s = 2;
constexpr double most_saturated = 0.01;  ///< share of the ticks
constexpr double speed_hz = 40;  ///< of the low-pass before the speed of the arm's own torque

/// Sets the initial state of the recorded run. A real arm begins near the scenario's start
/// (plant::GuardedRobot::start_tolerance) under a torque that holds it. An emulated arm begins at
/// the scenario's start, and its first reading differs by encoder errors only.
/// @param of_driver the run is one of a driver's arm
void begin_as_recorded(Recording& recording, bool of_driver) {
  const scenario::Scenario& scenario = recording.scenario;
  const plant::EncoderSpec& encoder = scenario.plant.encoder;
  plant::InitialState& initial = recording.scenario.plant.initial;
  const Vector first = recording.q.row(0).transpose();
  Vector off = scenario::encoder_count(scenario, *scenario.model).array() +
               (6 * encoder.noise_std_rad + 1e-9);
  if (encoder.eccentricity_rad.size() > 0) off += encoder.eccentricity_rad;
  if (((first - initial.position_rad).cwiseAbs().array() > off.array()).any()) {
    initial.position_rad = first;
  }
  if (initial.torque != plant::InitialTorque::zero) return;
  if (scenario.loop.command_delay > 0) {
    initial.torque_Nm = recording.tau.row(0).transpose();
  } else if (of_driver && !scenario.gives("plant.initial.torque")) {
    initial.torque = plant::InitialTorque::hold;  // until the arm takes the first torque
  }
}

/// Returns the torque that the arm told in a tick.
Vector told_torque(const logger::TickRecord& record, TorqueSource source,
                   const logger::RunLog& log) {
  using messages::truth::Told;
  const Told told = source == TorqueSource::accepted ? Told::accepted : Told::measured;
  if (!record.arm_torque || !record.arm_torque->tells(told)) {
    throw bad_usage("{}: holds no torque that the arm {}; allowed: --torque commanded",
                    log.path().string(),
                    source == TorqueSource::accepted ? "accepted" : "measured");
  }
  return told == Told::accepted ? record.arm_torque->accepted : record.arm_torque->measured;
}

/// Takes rotors and friction out of the scenario: sensors behind the gears do not see them.
void leave_links_alone(scenario::Scenario& scenario) {
  scenario.robot.rigid_rotor_inertia_kgm2.setZero();
  plant::DriveSpec& drive = scenario.plant.drive;
  for (Vector* friction : {&drive.viscous_friction_Nms_per_rad, &drive.coulomb_friction_Nm,
                           &drive.friction_rise_Nm, &drive.load_friction}) {
    friction->setZero();
  }
}

/// Takes rows of ticks of which some are missing.
/// @throw base::Failure(bad_usage) if too many are missing
void set_rows(Recording& recording, const Ticks& ticks) {
  constexpr double most_missed = 0.2, longest_gap_s = 0.02;
  FilledTicks filled = fill(ticks);
  const Eigen::Index rows = filled.q.rows();
  recording.q = std::move(filled.q);
  recording.tau = std::move(filled.tau);
  recording.missed = filled.missing + ticks.missed;
  if (static_cast<double>(recording.missed) <= most_missed * static_cast<double>(rows) &&
      static_cast<double>(filled.longest) * recording.scenario.loop.period_s <= longest_gap_s) {
    return;
  }
  throw bad_usage(
      "{}: {} of {} ticks are missed, up to {} in a row are missing; allowed: {:g} % and {:g} ms; "
      "record the run again",
      recording.source, recording.missed, rows, filled.longest, 100 * most_missed,
      1e3 * longest_gap_s);
}

}  // namespace

FilledTicks fill(const Ticks& ticks) {
  FilledTicks filled;
  if (ticks.tick.empty()) return filled;
  const std::int64_t first = ticks.tick.front();
  const auto rows = static_cast<Eigen::Index>(ticks.tick.back() - first) + 1;
  filled.q.resize(rows, ticks.q.cols());
  filled.tau.resize(rows, ticks.tau.cols());
  filled.missing = rows - std::ssize(ticks.tick);
  for (Eigen::Index i = 0, row = 0; i < std::ssize(ticks.tick); ++i, ++row) {
    const auto at = static_cast<Eigen::Index>(ticks.tick[static_cast<std::size_t>(i)] - first);
    const Eigen::Index gap = at - row;
    filled.longest = std::max<std::int64_t>(filled.longest, gap);
    for (Eigen::Index k = 0; k < gap; ++k, ++row) {
      const double x = static_cast<double>(k + 1) / static_cast<double>(gap + 1);
      filled.q.row(row) = (1 - x) * ticks.q.row(i - 1) + x * ticks.q.row(i);
      filled.tau.row(row) = ticks.tau.row(i - 1);
    }
    filled.q.row(row) = ticks.q.row(i);
    filled.tau.row(row) = ticks.tau.row(i);
  }
  return filled;
}

Eigen::MatrixXd sent_torque(const Recording& recording) {
  if (recording.own.size() == 0) return recording.tau;
  return recording.tau - recording.own;
}

void set_own_torque(Recording& recording, bool of_log) {
  const plant::OwnTorque own(recording.scenario);
  if (!own.any()) return;
  const double h = recording.scenario.loop.period_s;
  const Eigen::Index last = recording.num_ticks() - 1;
  const Eigen::MatrixXd smooth = low_passed(recording.q, h, speed_hz);
  recording.own.resizeLike(recording.tau);
  for (Eigen::Index k = 0; k <= last; ++k) {
    const Eigen::Index from = std::max<Eigen::Index>(0, k - 1), to = std::min(last, k + 1);
    const Vector v =
        (smooth.row(to) - smooth.row(from)).transpose() / (h * static_cast<double>(to - from));
    recording.own.row(k) = own.at(recording.q.row(k).transpose(), v).transpose();
  }
  if (!of_log) return;
  recording.own_late = 0.25;
  if (recording.controlled) return;  // the simulated arm does it
  const Eigen::MatrixXd change =
      recording.own_late * (recording.own.bottomRows(last) - recording.own.topRows(last));
  recording.own.bottomRows(last) -= change;
  recording.tau.bottomRows(last) -= change;
}

Recording with_torques_moved(const Recording& recording, double ticks) {
  Recording result = recording;
  result.moved = ticks;
  const double whole = std::floor(ticks), part = ticks - whole;
  const auto shift = static_cast<Eigen::Index>(whole);
  const Eigen::Index more = part > 0 ? 1 : 0;
  const Eigen::Index first = std::max<Eigen::Index>(0, shift + more),
                     rows = recording.num_ticks() - first - std::max<Eigen::Index>(0, -shift);
  result.q = recording.q.middleRows(first, rows);
  const Eigen::MatrixXd sent = sent_torque(recording);
  result.tau = (1 - part) * sent.middleRows(first - shift, rows) +
               part * sent.middleRows(first - shift - more, rows);
  if (recording.own.size() > 0) {
    result.own = recording.own.middleRows(first, rows);
    result.tau += result.own;
  }
  return result;
}

void require_usable(const Recording& recording) {
  const double seconds =
      static_cast<double>(recording.num_ticks()) * recording.scenario.loop.period_s;
  if (seconds < shortest_s) {
    throw bad_usage("{}: {:.3g} s of positions and torques; at least {:g} s are needed",
                    recording.source, seconds, shortest_s);
  }
  const Eigen::RowVectorXd range =
      recording.q.colwise().maxCoeff() - recording.q.colwise().minCoeff();
  const Vector count = scenario::encoder_count(recording.scenario, *recording.scenario.model);
  const double needed = std::max(0.02, count.size() > 0 ? 100 * count.maxCoeff() : 0.0);
  if (range.maxCoeff() >= needed) return;
  throw bad_usage(
      "{}: too little motion: no joint moves by more than {:.2g} rad (m), at least {:.2g} are "
      "needed; record a run whose reference moves every joint",
      recording.source, range.maxCoeff(), needed);
}

Eigen::MatrixXd TickRows::matrix(Eigen::Index columns) const {
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::Map<const Rows>(numbers_.data(), std::ssize(numbers_) / columns, columns);
}

Ticks read_ticks(logger::RunLog& log, bool to_stop, TorqueSource source) {
  const Eigen::Index n = log.scenario().num_joints;
  TickRows q, tau;
  Ticks result;
  logger::TickRecord record;
  while (log.next(record)) {
    if (!record.measurement || !record.truth) continue;
    const messages::truth::PlantTruth& truth = *record.truth;
    if (to_stop && truth.fault == messages::truth::DriveFault::protective_stop) break;
    const Vector positions = messages::links_of(*record.measurement);
    if (positions.size() != n) {
      throw bad_usage(
          "{}: holds no positions of the joints (links); record a law that measures them",
          log.path().string());
    }
    result.tick.push_back(record.tick);
    result.of_driver = result.of_driver && truth.q == positions;
    q.add(positions);
    tau.add(source == TorqueSource::commanded ? truth.tau : told_torque(record, source, log));
    result.saturated += std::count(truth.saturated.begin(), truth.saturated.begin() + n, true) > 0;
    result.missed += truth.fault == messages::truth::DriveFault::command_missed ? 1 : 0;
  }
  result.q = q.matrix(n);
  result.tau = tau.matrix(n);
  return result;
}

Recording read_recording(const std::filesystem::path& log, TorqueSource source) {
  logger::RunLog run = logger::RunLog::open(log);
  Recording result{log.string(), run.scenario(), {}, {}};
  if (result.scenario.robot.flexible) {
    throw bad_usage("{}: a robot with flexible joints; identify is for rigid ones", result.source);
  }
  const plant::Spec& plant = result.scenario.plant;
  if (const std::string_view key = plant::key_without_torques(plant); !key.empty()) {
    throw bad_usage(
        "{}: a run with {}, in which the robot was sent nothing; record a run without it",
        result.source, key);
  }
  Ticks ticks = read_ticks(run, false, source);
  set_rows(result, ticks);
  if (!run.summary().gains.empty()) {
    throw bad_usage("{}: the law's gains change at tick {}; record a run whose gains stay",
                    result.source, run.summary().gains.front().tick);
  }
  if (static_cast<double>(ticks.saturated) >
      most_saturated * static_cast<double>(result.num_ticks())) {
    throw bad_usage("{}: a torque was at its limit in {} of {} ticks; record a slower motion",
                    result.source, ticks.saturated, result.num_ticks());
  }
  require_usable(result);
  result.controlled = source == TorqueSource::commanded && result.missed == 0;
  const bool sent = source == TorqueSource::commanded || source == TorqueSource::accepted;
  const bool of_driver = ticks.of_driver && result.scenario.loop.mode == scenario::Mode::realtime;
  if (result.controlled) begin_as_recorded(result, of_driver);
  if (sent && of_driver) set_own_torque(result, /*of_log=*/true);
  if (source == TorqueSource::behind_gear) leave_links_alone(result.scenario);
  return result;
}

void require_same_robot(const Recording& first, const Recording& other) {
  const scenario::RobotSpec &a = first.scenario.robot, &b = other.scenario.robot;
  if (a.urdf_text == b.urdf_text && a.locked == b.locked && a.base.rpy == b.base.rpy &&
      a.gravity_m_per_s2 == b.gravity_m_per_s2) {
    return;
  }
  throw bad_usage(
      "{}: is of another robot than {}: URDF, locked joints, base or gravity differ; identify "
      "each robot by itself",
      other.source, first.source);
}

}  // namespace tachless::identify
