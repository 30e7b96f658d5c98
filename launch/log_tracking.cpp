#include "launch/log_tracking.h"

#include <variant>

namespace launch {
namespace {

struct Angles {
  robot::Vector q, theta;
};

Angles angles_of(const logger::TickRecord& record) {
  if (record.truth) return {record.truth->q, record.truth->theta};
  if (const auto* m = std::get_if<robot::PositionMeasurement>(&record.measurement)) {
    return {m->q, {}};
  }
  if (const auto* m = std::get_if<robot::LinkStateMeasurement>(&record.measurement)) {
    return {m->q, m->theta};
  }
  if (const auto* m = std::get_if<robot::StateMeasurement>(&record.measurement)) {
    return {m->q, m->theta};
  }
  return {};
}

}  // namespace

Tracking track(logger::RunLog& log) {
  Tracking tracking(log.layout().num_joints);
  log.rewind();
  logger::TickRecord record;
  while (log.next(record)) {
    const Angles angles = angles_of(record);
    if (angles.q.size() == 0 || !record.reference || !(record.truth || record.command)) continue;
    const double t_s = static_cast<double>(record.tick) * log.info().period_s;
    tracking.add(t_s, angles.q, record.reference->q_ref, angles.theta,
                 record.truth ? record.truth->tau : record.command->tau);
  }
  return tracking;
}

}  // namespace launch
