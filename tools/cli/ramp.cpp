// The way from where an arm stands to where a scenario begins: run --ramp.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/logging.h"
#include "cli/run.h"
#include "commission/trials.h"
#include "logger/run_log.h"
#include "plant/guarded_robot.h"
#include "plant/plant_model.h"
#include "reference/trajectory/point_to_point.h"
#include "robot/dynamics.h"

namespace tachless::cli {
namespace {

namespace fs = std::filesystem;
using base::ExitCode;
using base::Failure;
using commission::list;

constexpr double share = 0.1;  ///< of the torque limits
constexpr double look_s = 0.1;
constexpr double shortest_s = 1, rest_s = 1;

/// The joints' positions that a run has measured last, in the scenario's coordinates.
Vector end_of(const fs::path& path) {
  logger::RunLog log = logger::RunLog::open(path);
  Vector q;
  logger::TickRecord record;
  while (log.next(record)) {
    if (record.truth) q = record.truth->q;
  }
  if (q.size() == 0) throw base::bad_usage("{}: no positions of the arm", path.string());
  return q;
}

/// How long the motion has to be that needs no more than a share of the limits of speed, and of
/// those of torque beyond what holds the arm still.
double duration(const scenario::Scenario& scenario, const Vector& from, const Vector& to) {
  const robot::Model model = plant::plant_model(scenario);
  const Vector limit = scenario.plant.drive.torque_limit_Nm.value_or(
      Vector::Constant(model.num_joints, robot::Model::unlimited));
  reference::trajectory::PointToPoint motion{from, to, 0, 1};
  constexpr int points = 200;
  double seconds = shortest_s;
  const auto at = [&](int i) { return motion.at(motion.duration_s * i / points); };
  const Vector speed = commission::careful_speed(model);
  for (int i = 0; i <= points; ++i) {
    seconds = std::max(seconds, at(i).v_ref.cwiseAbs().cwiseQuotient(speed).maxCoeff());
  }
  motion.duration_s = seconds;
  double used = 0;  // of the torque that is allowed; it falls with the square of the duration
  for (int i = 0; i <= points; ++i) {
    const messages::ReferencePoint r = at(i);
    const Vector moving = robot::inverse_dynamics<double>(model, r.q_ref, r.v_ref, r.a_ref) -
                          robot::gravity_torque(model, r.q_ref);
    used = std::max(used, (moving.cwiseAbs().array() / (share * limit.array())).maxCoeff());
  }
  return seconds * std::sqrt(std::max(1.0, used));
}

class Ramp {
 public:
  Ramp(const RunOptions& options, const PlannedRun& run)
      : scenario_(run.scenario), each_(options), path_(run.options.scenario) {
    folder_ = options.out.empty() ? fs::path("out") / (scenario_.name + "-ramp")
                                  : fs::path((options.out / "").parent_path().string() + "-ramp");
    if (!run.options.robot.empty()) folder_ /= run.options.robot;
    each_.ramp = each_.json = each_.watch = false;
    each_.overwrite = true;
    each_.run_id = 0;
    each_.overrides = run.options.overrides;  // with loop.max_missed, where that is found
  }

  /// Brings the arm to where the scenario begins.
  /// @return done, or the exit code of the run that ended badly
  ExitCode carry_out() {
    const Vector& start = scenario_.plant.initial.position_rad;
    Vector q;
    if (const ExitCode code = look(q); code != ExitCode::done) return code;
    Eigen::Index farthest = 0;
    if ((q - start).cwiseAbs().maxCoeff(&farthest) <= plant::GuardedRobot::start_tolerance) {
      return ExitCode::done;
    }
    require_in_range(q);
    const double seconds = duration(scenario_, q, start);
    base::log_info("ramp: {} is at {:.4g}, the scenario begins at {:.4g}; {:.1f} s to there",
                   robot::joint_labels(*scenario_.model).joint(static_cast<std::size_t>(farthest)),
                   q[farthest], start[farthest], seconds);
    const ExitCode code =
        run("ramp", seconds + rest_s,
            {fmt::format("plant.initial.position_rad={}", list(q)), "plant.initial.torque=hold",
             fmt::format("reference={{point_to_point: {{from_rad: {}, to_rad: "
                         "{}, duration_s: {:.6g}}}}}",
                         list(q), list(start), seconds)});
    if (code == ExitCode::done) require_arrived(end_of(folder_ / "ramp" / "lcmlog"));
    return code;
  }

 private:
  /// A dry run that tells where the arm stands.
  ExitCode look(Vector& q) {
    const bool quiet = std::exchange(each_.quiet, true);
    const ExitCode code = run("look", look_s, {"plant.dry_run=true", "loop.max_missed_share=1"});
    each_.quiet = quiet;
    if (code == ExitCode::done) q = end_of(folder_ / "look" / "lcmlog");
    return code;
  }

  ExitCode run(const char* name, double seconds, const std::vector<std::string>& changes) {
    RunOptions options = each_;
    options.out = folder_ / name;
    options.duration_s.clear();
    options.overrides.insert(options.overrides.end(), changes.begin(), changes.end());
    const double h = scenario_.loop.period_s;
    options.overrides.push_back(
        fmt::format("loop.duration_s={:.12g}", std::max(20.0, std::round(seconds / h)) * h));
    return cli::run(options, {path_});
  }

  void require_in_range(const Vector& q) const {
    const robot::Model& model = *scenario_.model;
    for (Eigen::Index j = 0; j < q.size(); ++j) {
      if (q[j] >= model.lower[j] && q[j] <= model.upper[j]) continue;
      throw Failure(ExitCode::check_said_no,
                    "ramp: {} stands at {:.6g}, outside of its range {:.6g} to {:.6g}; move it by "
                    "hand, or see robot.joint_offsets_rad",
                    robot::joint_labels(model).joint(static_cast<std::size_t>(j)), q[j],
                    model.lower[j], model.upper[j]);
    }
  }

  void require_arrived(const Vector& q) const {
    const Vector& start = scenario_.plant.initial.position_rad;
    Eigen::Index j = 0;
    const double beside = (q - start).cwiseAbs().maxCoeff(&j);
    if (beside <= plant::GuardedRobot::start_tolerance) return;
    throw Failure(ExitCode::check_said_no,
                  "ramp: {} rests at {:.6g}, {:.2g} beside where the scenario begins, {:.2g} is "
                  "allowed; friction holds it, or the model's gravity is wrong: stiffer gains, "
                  "loria_ortega_integral, or a start where it rests",
                  robot::joint_labels(*scenario_.model).joint(static_cast<std::size_t>(j)), q[j],
                  beside, plant::GuardedRobot::start_tolerance);
  }

  const scenario::Scenario& scenario_;
  RunOptions each_;
  fs::path path_, folder_;
};

}  // namespace

ExitCode ramp(const RunOptions& options, const PlannedRun& run) {
  return Ramp(options, run).carry_out();
}

}  // namespace tachless::cli
