#include "study/in_process_loop.h"

#include <optional>
#include <stdexcept>
#include <string>

#include "controller/catalogue.h"
#include "plant/encoder.h"
#include "plant/plant_model.h"
#include "reference/make_trajectory.h"

namespace tachless::study {
namespace {

diagnostics::Failure protective_stop(std::int64_t tick, const std::string& cause) {
  return {diagnostics::ExitCode::protective_stop, "tick " + std::to_string(tick) + ": " + cause};
}

template <class L>
plant::ArmState run(const experiment::Scenario& scenario, const L& law,
                    const std::function<bool(const TickRecord&)>& on_tick) {
  using Measurement = typename L::Measurement;
  const robot::Model model = plant::plant_model(scenario);
  plant::require_encoders<Measurement>(scenario);
  const plant::Encoder encoder(scenario, model);
  const reference::Trajectory trajectory = reference::make_trajectory(scenario);
  plant::Arm arm = plant::make_arm(scenario, model);
  plant::Drive drive = plant::make_drive(scenario, model);
  const double h = scenario.loop.period_s;

  std::optional<typename L::Memory> memory;
  TickRecord record;
  for (std::int64_t k = 0; k < scenario.loop.num_ticks; ++k) {
    record.tick = k;
    record.time_s = static_cast<double>(k) * h;
    record.truth = arm.state();
    record.measurement = encoder.measure<Measurement>(arm.state(), k);
    record.reference = trajectory.at(record.time_s);

    const Measurement& measurement = std::get<Measurement>(record.measurement);
    if (!memory) memory = law.start(measurement, record.reference);
    auto step = law.step(*memory, measurement, record.reference);
    memory = std::move(step.memory);
    record.command = std::move(step.command);
    record.controller = std::move(step.state);

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
  return controller::with_law(scenario,
                              [&](const auto& law) { return run(scenario, law, on_tick); });
}

}  // namespace tachless::study
