#include "report/log_tracking.h"

#include <variant>

namespace tachless::report {
namespace {

struct Angles {
  robot::Vector q, theta;
};

Angles angles_of(const logger::TickRecord& record) {
  if (record.truth) return {record.truth->q, record.truth->theta};
  Angles angles;
  std::visit(
      [&](const auto& measurement) {
        if constexpr (requires { measurement.q; }) {
          angles.q = measurement.q;
          if constexpr (requires { measurement.theta; }) angles.theta = measurement.theta;
        }
      },
      record.measurement);
  return angles;
}

}  // namespace

void add(study::Tracking& tracking, const logger::TickRecord& record, double period_s) {
  const Angles angles = angles_of(record);
  if (angles.q.size() == 0 || !record.reference || !(record.truth || record.command)) return;
  tracking.add(static_cast<double>(record.tick) * period_s, angles.q, record.reference->q_ref,
               angles.theta, record.truth ? record.truth->tau : record.command->tau);
}

study::Tracking track(logger::RunLog& log) {
  study::Tracking tracking(log.layout().num_joints);
  log.rewind();
  logger::TickRecord record;
  while (log.next(record)) add(tracking, record, log.info().period_s);
  return tracking;
}

}  // namespace tachless::report
