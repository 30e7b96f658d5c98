#include "logger/table.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <set>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "logger/tick_messages.h"
#include "messages/measurements.h"

namespace tachless::logger {
namespace {

using messages::truth::Told;

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

// The values of a member as `count` numbers.
void copy(const Vector& vector, std::size_t count, double* to) {
  if (static_cast<std::size_t>(vector.size()) != count) {
    throw std::logic_error("logger::Quantity: a vector of another size than the robot's");
  }
  std::copy_n(vector.data(), count, to);
}
void copy(const std::array<bool, max_joints>& flags, std::size_t count, double* to) {
  std::copy_n(flags.begin(), count, to);
}
void copy(messages::truth::DriveFault fault, std::size_t /*count*/, double* to) {
  *to = static_cast<double>(fault);
}
void copy(double value, std::size_t /*count*/, double* to) { *to = value; }

struct Builder {
  const robot::Model& model;
  messages::Layout layout;
  bool disturbed;
  std::vector<Quantity> quantities = {};

  /// `get`: TickRecord -> const Member&.
  template <class Member, class Get>
  void add(const std::string& name, std::string_view unit, const std::string& description,
           Slot slot, Get get) {
    constexpr bool per_joint = !std::is_enum_v<Member> && !std::is_same_v<Member, double>;
    const auto [revolute, prismatic] = column_units(unit);
    Quantity quantity{name, {}, description, slot, {}, {}};
    if (per_joint) quantity.joints = model.joint_names;
    for (std::size_t i = 0; i < (per_joint ? model.joint_types.size() : 1); ++i) {
      const bool slides = model.joint_types[i] == robot::JointType::prismatic;
      quantity.units.push_back(slides ? prismatic : revolute);
    }
    quantity.read = [get, count = quantity.units.size()](const TickRecord& record, double* values) {
      copy(get(record), count, values);
    };
    quantities.push_back(std::move(quantity));
  }

  /// The fields of `Value`'s message from the one numbered `first` to before `last`.
  template <class Value>
  void add_message(std::string_view symbol_suffix, std::string_view meaning_suffix,
                   std::size_t first = 0, std::size_t last = std::string_view::npos) {
    std::size_t number = 0;
    messages::for_each_field<Value>([&]<class Member>(const messages::Field<Value, Member>& field) {
      const bool wanted = number >= first && number < last;
      ++number;
      if constexpr (std::is_same_v<Member, std::string>) {
        return;
      } else {
        if (!wanted || (field.count == messages::Count::motors && layout.num_motors == 0) ||
            (field.name == "disturbance" && !disturbed)) {
          return;
        }
        add<Member>(fmt::format("{}{}", field.symbol, symbol_suffix), field.unit,
                    fmt::format("{}{}", field.meaning, meaning_suffix), messages::slot_of<Value>(),
                    [member = field.member](const TickRecord& record) -> const Member& {
                      return messages::get<Value>(record).*member;
                    });
      }
    });
  }

  /// The torques that a real arm tells; NaN if it does not tell them.
  void add_arm_torque() {
    using messages::truth::ArmTorque;
    const Vector none = Vector::Constant(layout.num_joints, NAN);
    messages::for_each_field<ArmTorque>(
        [&]<class Member>(const messages::Field<ArmTorque, Member>& field) {
          if constexpr (std::is_same_v<Member, Vector>) {
            const auto one = field.member == &ArmTorque::accepted ? Told::accepted : Told::measured;
            add<Vector>(std::string(field.symbol), field.unit, std::string(field.meaning),
                        Slot::arm_torque,
                        [=, member = field.member](const TickRecord& record) -> const Vector& {
                          return record.arm_torque->tells(one) ? *record.arm_torque.*member : none;
                        });
          }
        });
  }
};

}  // namespace

std::string column_name(std::string_view quantity, std::string_view joint, std::string_view unit) {
  std::string text(quantity);
  if (!joint.empty()) text.append(1, '_').append(joint);
  if (unit != "1") text.append(1, '_').append(unit);
  return text;
}

std::vector<std::string> joints_in_columns(const std::vector<std::string>& quantities,
                                           const std::vector<std::string>& joint_names) {
  std::set<std::string> different;
  std::vector<std::string> numbers;
  for (const std::string& joint : joint_names) {
    for (const std::string& quantity : quantities) {
      different.insert(column_name(quantity, joint, "1"));
    }
    numbers.push_back(std::to_string(numbers.size() + 1));
  }
  return different.size() == quantities.size() * joint_names.size() ? joint_names : numbers;
}

void add_number(std::string& text, double value) {
  std::array<char, 32> digits;
  const auto written = std::to_chars(digits.data(), digits.data() + digits.size(), value,
                                     std::chars_format::general, 17);
  text.append(digits.data(), written.ptr);
}

std::string Quantity::column(std::size_t component) const {
  return column_name(name, joints.empty() ? "" : joints[component], units[component]);
}

std::vector<Quantity> quantities_of(const scenario::Scenario& scenario,
                                    const messages::LawInfo& law) {
  const robot::Model& model = *scenario.model;
  Builder to{model, messages::layout(scenario.num_joints, scenario.robot.flexible.has_value()),
             has_disturbance(scenario)};
  using Truth = messages::truth::PlantTruth;
  to.add_message<Truth>("", ", true", 0, Truth::num_states);
  to.add_message<messages::ReferencePoint>("", "");
  to.add_message<messages::TorqueCommand>("", "");
  const auto signals = messages::parse_signals(law.signals).value();
  for (std::size_t i = 0; i < signals.size(); ++i) {
    const std::string name(signals[i].name);
    to.add<Vector>(name, signals[i].unit, "signal of the law: " + name, Slot::controller_state,
                   [i](const TickRecord& record) -> const Vector& {
                     return record.controller_state->value[i];
                   });
  }
  messages::with_measurement(law.measurement, [&]<class M>(std::type_identity<M>) {
    to.add_message<M>("_measured", " as measured");
  });
  to.add_message<Truth>("", "", Truth::num_states);
  if (has_slot(scenario, Slot::contact)) to.add_message<messages::truth::Contact>("", "");
  if (has_slot(scenario, Slot::arm_torque)) to.add_arm_torque();
  std::vector<std::string> names;
  for (const Quantity& each : to.quantities) names.push_back(each.name);
  const auto joints = joints_in_columns(names, model.joint_names);
  for (Quantity& each : to.quantities) {
    if (!each.joints.empty()) each.joints = joints;
  }
  return std::move(to.quantities);
}

}  // namespace tachless::logger
