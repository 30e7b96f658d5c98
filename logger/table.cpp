#include "logger/table.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace tachless::logger {
namespace {

using robot::Vector;
using Units = std::vector<std::string>;

/// Units of a quantity that is `revolute` on a revolute joint.
Units by_joint(const std::vector<robot::JointType>& types, const std::string& revolute,
               const std::string& prismatic) {
  Units units;
  for (const auto type : types) {
    units.push_back(type == robot::JointType::prismatic ? prismatic : revolute);
  }
  return units;
}

/// Units in a column's name, on a revolute and on a prismatic joint: rad/s gives rad_per_s,
/// m_per_s.
std::pair<std::string, std::string> column_units(std::string_view unit) {
  std::string revolute;
  for (const char c : unit) {
    if (c == '/') {
      revolute += "_per_";
    } else if (c != ' ' && c != '^') {
      revolute += c;
    }
  }
  std::string prismatic = revolute;
  if (revolute == "Nm") prismatic = "N";
  if (revolute.starts_with("rad")) prismatic = "m" + revolute.substr(3);
  return {revolute, prismatic};
}

struct Builder {
  std::vector<robot::JointType> types;
  std::vector<Quantity> quantities;

  /// `get`: TickRecord -> const Vector&.
  template <class Get>
  void add(const std::string& name, const std::string& revolute, const std::string& prismatic,
           Piece piece, const std::string& description, Get get) {
    const auto size = static_cast<Eigen::Index>(types.size());
    quantities.push_back({name, by_joint(types, revolute, prismatic), description, piece, true,
                          false, [get, size, name](const TickRecord& record, double* values) {
                            const Vector& vector = get(record);
                            if (vector.size() != size) {
                              throw std::logic_error("logger::Quantity: size of " + name);
                            }
                            std::copy_n(vector.data(), size, values);
                          }});
  }

  template <class Kind>
  void add_measured(const std::string& name, const std::string& revolute,
                    const std::string& prismatic, const std::string& description,
                    Vector Kind::*member) {
    add(name + "_measured", revolute, prismatic, Piece::measurement, description,
        [member](const TickRecord& record) -> const Vector& {
          return std::get<Kind>(record.measurement).*member;
        });
  }
};

}  // namespace

std::string Quantity::column(std::size_t component) const {
  std::string text = name;
  if (per_joint) text.append(1, '_').append(std::to_string(component + 1));
  if (units[component] != "1") text.append(1, '_').append(units[component]);
  return text;
}

std::vector<Quantity> quantities_of(const RunLog& log) {
  const auto& scenario = log.scenario();
  const bool flexible = log.layout().num_motors != 0;
  Builder to;
  to.types = log.scenario().model->joint_types;

  const auto truth = [&](const char* name, const char* revolute, const char* prismatic,
                         const char* description, Vector loop::truth::PlantTruth::*member) {
    to.add(name, revolute, prismatic, Piece::truth, description,
           [member](const TickRecord& r) -> const Vector& { return (*r.truth).*member; });
  };
  using loop::truth::PlantTruth;
  truth("q", "rad", "m", "link position, true", &PlantTruth::q);
  truth("v", "rad_per_s", "m_per_s", "link velocity, true", &PlantTruth::v);
  if (flexible) {
    truth("theta", "rad", "m", "motor position on the link side of the gear, true",
          &PlantTruth::theta);
    truth("thetadot", "rad_per_s", "m_per_s", "motor velocity, true", &PlantTruth::thetadot);
  }

  const auto reference = [&](const char* name, const std::string& per, const char* description,
                             Vector loop::ReferencePoint::*member) {
    to.add(name, "rad" + per, "m" + per, Piece::reference, description,
           [member](const TickRecord& r) -> const Vector& { return (*r.reference).*member; });
  };
  using loop::ReferencePoint;
  reference("q_ref", "", "reference position", &ReferencePoint::q_ref);
  reference("v_ref", "_per_s", "reference velocity", &ReferencePoint::v_ref);
  reference("a_ref", "_per_s2", "reference acceleration", &ReferencePoint::a_ref);
  reference("jerk_ref", "_per_s3", "reference jerk", &ReferencePoint::jerk_ref);
  reference("snap_ref", "_per_s4", "reference snap", &ReferencePoint::snap_ref);

  to.add("tau", "Nm", "N", Piece::command, "motor torque commanded from this tick's measurement",
         [](const TickRecord& r) -> const Vector& { return r.command->tau; });

  const auto signals = loop::parse_signals(log.info().signals).value();
  for (std::size_t i = 0; i < signals.size(); ++i) {
    const auto [revolute, prismatic] = column_units(signals[i].unit);
    to.add(std::string(signals[i].name), revolute, prismatic, Piece::controller_state,
           "signal of the law: " + std::string(signals[i].name),
           [i](const TickRecord& r) -> const Vector& { return r.controller_state->value[i]; });
  }

  const auto& measurement = log.info().measurement;
  const auto is = [&](std::string_view suffix) { return measurement == suffix; };
  constexpr auto q_text = "link position as measured";
  constexpr auto v_text = "link velocity as measured";
  constexpr auto theta_text = "motor position as measured";
  constexpr auto thetadot_text = "motor velocity as measured";
  if (is(loop::ChannelOf<loop::PositionMeasurement>::suffix)) {
    to.add_measured("q", "rad", "m", q_text, &loop::PositionMeasurement::q);
  } else if (is(loop::ChannelOf<loop::MotorPositionMeasurement>::suffix)) {
    to.add_measured("theta", "rad", "m", theta_text, &loop::MotorPositionMeasurement::theta);
  } else if (is(loop::ChannelOf<loop::LinkStateMeasurement>::suffix)) {
    to.add_measured("q", "rad", "m", q_text, &loop::LinkStateMeasurement::q);
    to.add_measured("v", "rad_per_s", "m_per_s", v_text, &loop::LinkStateMeasurement::v);
    to.add_measured("theta", "rad", "m", theta_text, &loop::LinkStateMeasurement::theta);
  } else {
    to.add_measured("q", "rad", "m", q_text, &loop::StateMeasurement::q);
    to.add_measured("v", "rad_per_s", "m_per_s", v_text, &loop::StateMeasurement::v);
    if (flexible) {
      to.add_measured("theta", "rad", "m", theta_text, &loop::StateMeasurement::theta);
      to.add_measured("thetadot", "rad_per_s", "m_per_s", thetadot_text,
                      &loop::StateMeasurement::thetadot);
    }
  }

  truth("tau_applied", "Nm", "N", "torque applied over the tick, after the limit",
        &PlantTruth::tau);
  const std::size_t joints = to.types.size();
  to.quantities.push_back({"saturated", Units(joints, "1"),
                           "1 when the commanded torque exceeded the limit", Piece::truth, true,
                           true, [joints](const TickRecord& r, double* values) {
                             for (std::size_t i = 0; i < joints; ++i) {
                               values[i] = r.truth->saturated[i] ? 1 : 0;
                             }
                           }});
  to.quantities.push_back(
      {"drive_fault",
       {"1"},
       "0 none, 1 command missed (last torque held), 2 protective stop",
       Piece::truth,
       false,
       true,
       [](const TickRecord& r, double* values) { *values = static_cast<double>(r.truth->fault); }});
  return std::move(to.quantities);
}

}  // namespace tachless::logger
