#include "study/in_process_loop.h"

#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

#include "controller/law_stepper.h"
#include "controller/registry.h"
#include "plant/encoder.h"
#include "plant/plant_model.h"
#include "reference/make_trajectory.h"

namespace tachless::study {
namespace {

diagnostics::Failure protective_stop(std::int64_t tick, const std::string& cause) {
  return {diagnostics::ExitCode::protective_stop, "tick " + std::to_string(tick) + ": " + cause};
}

template <class Measurement>
plant::ArmState run(const experiment::Scenario& scenario,
                    std::unique_ptr<controller::AnyLaw<Measurement>> law,
                    const std::function<bool(const TickRecord&)>& on_tick) {
  const robot::Model model = plant::plant_model(scenario);
  plant::require_encoders<Measurement>(scenario);
  const plant::Encoder encoder(scenario, model);
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  plant::Arm arm = plant::make_arm(scenario, model);
  plant::Drive drive = plant::make_drive(scenario, model);
  const double h = scenario.loop.period_s;

  controller::LawStepper<Measurement> stepper(std::move(law), scenario.loop);
  TickRecord record;
  for (std::int64_t k = 0; k < scenario.loop.num_ticks; ++k) {
    record.tick = k;
    record.time_s = static_cast<double>(k) * h;
    record.truth = arm.state();
    record.measurement = encoder.measure<Measurement>(arm.state(), k);
    record.reference = trajectory.at(record.time_s);

    const Measurement& measurement = std::get<Measurement>(record.measurement);
    const auto step = stepper.step(k, measurement, record.reference);
    stepper.keep(k);
    record.command = step.output.command;
    record.controller = step.output.signals;

    if (!drive.accept(record.command)) {
      throw protective_stop(k,
                            "the law commands a torque that is not finite; look at "
                            "controller.gains and loop.period_s");
    }
    record.applied = drive.applied();
    try {
      arm.advance(record.applied.tau, static_cast<double>(k + 1) * h);
    } catch (const std::runtime_error& error) {
      throw protective_stop(k, error.what());
    }
    drive.end_tick();
    if (!on_tick(record)) break;
  }
  return arm.state();
}

}  // namespace

plant::ArmState run_in_process(const experiment::Scenario& scenario,
                               const std::function<bool(const TickRecord&)>& on_tick) {
  return std::visit([&](auto law) { return run(scenario, std::move(law), on_tick); },
                    controller::scenario_law(scenario));
}

}  // namespace tachless::study
