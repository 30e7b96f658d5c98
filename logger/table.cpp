#include "logger/table.h"

#include <fmt/core.h>

#include <algorithm>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "logger/column_names.h"
#include "loop/measurements.h"

namespace tachless::logger {
namespace {

using loop::Count;
using robot::Vector;

/// Units in a column's name, on a revolute and on a prismatic joint: rad/s gives rad_per_s,
/// m_per_s.
std::pair<std::string, std::string> column_units(std::string_view unit) {
  if (unit.empty()) return {"1", "1"};
  if (unit == "N m") return {"Nm", "N"};
  std::string revolute;
  for (const char c : unit) {
    if (c == '/') {
      revolute += "_per_";
    } else if (c != ' ' && c != '^') {
      revolute += c;
    }
  }
  const bool angle = revolute == "rad" || revolute.starts_with("rad_");
  return {revolute, angle ? "m" + revolute.substr(3) : revolute};
}

struct Builder {
  std::vector<robot::JointType> types;
  std::vector<std::string> joints;
  std::vector<Quantity> quantities;

  [[nodiscard]] std::vector<std::string> units(std::string_view unit) const {
    const auto [revolute, prismatic] = column_units(unit);
    std::vector<std::string> result;
    for (const auto type : types) {
      result.push_back(type == robot::JointType::prismatic ? prismatic : revolute);
    }
    return result;
  }

  /// One column per joint; `get`: TickRecord -> const Vector&.
  template <class Get>
  void add_vector(const std::string& name, std::string_view unit, const std::string& description,
                  Slot slot, Get get) {
    const auto size = static_cast<Eigen::Index>(types.size());
    quantities.push_back({name, units(unit), description, slot, joints, false,
                          [get, size, name](const TickRecord& record, double* values) {
                            const Vector& vector = get(record);
                            if (vector.size() != size) {
                              throw std::logic_error("logger::Quantity: size of " + name);
                            }
                            std::copy_n(vector.data(), size, values);
                          }});
  }

  /// The columns of one field of `Value`'s message.
  template <class Value, class Member>
  void add_field(const loop::Field<Value, Member>& field, std::string_view symbol_suffix,
                 std::string_view meaning_suffix) {
    const auto name = fmt::format("{}{}", field.symbol, symbol_suffix);
    const auto text = fmt::format("{}{}", field.meaning, meaning_suffix);
    constexpr Slot slot = loop::slot_of<Value>();
    const auto member = field.member;
    if constexpr (std::is_same_v<Member, Vector>) {
      add_vector(name, field.unit, text, slot, [member](const TickRecord& record) -> const Vector& {
        return (*loop::find<Value>(record)).*member;
      });
    } else if constexpr (std::is_enum_v<Member>) {
      quantities.push_back(
          {name, {"1"}, text, slot, {}, true, [member](const TickRecord& record, double* values) {
             *values = static_cast<double>((*loop::find<Value>(record)).*member);
           }});
    } else {
      quantities.push_back(
          {name, units(field.unit), text, slot, joints, true,
           [member, count = types.size()](const TickRecord& record, double* values) {
             const Member& flags = (*loop::find<Value>(record)).*member;
             std::copy_n(flags.begin(), count, values);
           }});
    }
  }

  /// The fields of `Value`'s message from the one numbered `first` to before `last`.
  template <class Value>
  void add_message(const loop::Layout& layout, std::string_view symbol_suffix,
                   std::string_view meaning_suffix, std::size_t first = 0,
                   std::size_t last = std::string_view::npos, std::string_view without = {}) {
    std::size_t number = 0;
    loop::for_each_field<Value>([&](const auto& field) {
      const bool wanted = number >= first && number < last && field.name != without;
      ++number;
      if (!wanted || (field.count == Count::motors && layout.num_motors == 0)) return;
      add_field(field, symbol_suffix, meaning_suffix);
    });
  }
};

}  // namespace

std::string Quantity::column(std::size_t component) const {
  return column_name(name, joints.empty() ? "" : joints[component], units[component]);
}

std::vector<Quantity> quantities_of(const RunLog& log) {
  return quantities_of(log.scenario(),
                       {log.info().law, log.info().measurement, log.info().signals});
}

std::vector<Quantity> quantities_of(const experiment::Scenario& scenario,
                                    const loop::LawInfo& law) {
  const loop::Layout layout =
      loop::layout(scenario.num_joints, scenario.robot.flexible.has_value());
  const robot::Model& model = *scenario.model;
  Builder to{model.joint_types, model.joint_names, {}};
  using Truth = loop::truth::PlantTruth;
  constexpr std::size_t num_states = loop::MessageOf<Truth>::num_states;
  to.add_message<Truth>(layout, "", ", true", 0, num_states);
  to.add_message<loop::ReferencePoint>(layout, "", "");
  to.add_message<loop::TorqueCommand>(layout, "", "");
  const auto signals = loop::parse_signals(law.signals).value();
  for (std::size_t i = 0; i < signals.size(); ++i) {
    const std::string name(signals[i].name);
    to.add_vector(name, signals[i].unit, "signal of the law: " + name, Slot::controller_state,
                  [i](const TickRecord& record) -> const Vector& {
                    return record.controller_state->value[i];
                  });
  }
  loop::with_measurement(law.measurement, [&]<class M>(std::type_identity<M>) {
    to.add_message<M>(layout, "_measured", " as measured");
  });
  const bool disturbed = !scenario.plant.disturbances.empty();
  to.add_message<Truth>(layout, "", "", num_states, std::string_view::npos,
                        disturbed ? "" : "disturbance");
  std::vector<std::string> names;
  for (const Quantity& each : to.quantities) names.push_back(each.name);
  const auto joints = joints_in_columns(names, model.joint_names);
  for (Quantity& each : to.quantities) {
    if (!each.joints.empty()) each.joints = joints;
  }
  return std::move(to.quantities);
}

}  // namespace tachless::logger
