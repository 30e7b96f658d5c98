// Prints the largest position error of each joint, of a scenario that it simulates or of a run's
// log:
//   simulate_and_read scenarios/practical_rigid.yaml
//   simulate_and_read out/practical_rigid

#include <fmt/core.h>

#include <exception>
#include <filesystem>

#include <tachless/base/failure.h>
#include <tachless/in_process/in_process_loop.h>
#include <tachless/logger/log_file.h>
#include <tachless/logger/run_log.h>
#include <tachless/robot/model.h>
#include <tachless/scenario/scenario.h>

using namespace tachless;

int main(int argc, char** argv) {
  try {
    if (argc != 2) throw base::bad_usage("usage: simulate_and_read SCENARIO.yaml|LOG");
    const std::filesystem::path path = argv[1];
    const auto print = [](const scenario::Scenario& scenario, const Vector& largest) {
      const robot::JointLabels joints = robot::joint_labels(*scenario.model);
      for (int i = 0; i < scenario.num_joints; ++i) {
        fmt::print("{}: largest error {} {}\n", joints.name[i], largest[i], joints.length[i]);
      }
    };
    if (path.extension() == ".yaml") {
      const scenario::Scenario scenario = scenario::load_scenario(path);
      Vector largest = Vector::Zero(scenario.num_joints);
      in_process::run_in_process(scenario, [&](const in_process::TickRecord& tick) {
        largest = largest.cwiseMax((tick.truth.q - tick.reference.q_ref).cwiseAbs());
        return true;  // false ends the run
      });
      print(scenario, largest);
    } else {
      logger::RunLog log = logger::RunLog::open(logger::find_log(path));
      Vector largest = Vector::Zero(log.scenario().num_joints);
      for (logger::TickRecord tick; log.next(tick);) {
        if (!tick.truth || !tick.reference) continue;  // the message was lost in realtime
        largest = largest.cwiseMax((tick.truth->q - tick.reference->q_ref).cwiseAbs());
      }
      print(log.scenario(), largest);
    }
    return 0;
  } catch (const std::exception&) {
    return base::told_exception("the command line");
  }
}
