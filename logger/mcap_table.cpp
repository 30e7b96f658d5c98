#include "logger/mcap_table.h"

#include <fmt/format.h>

#include <cmath>

#include "diagnostics/json_text.h"

namespace tachless::logger {
namespace {

constexpr std::string_view joint_states = "foxglove.JointStates";
constexpr std::string_view joint_states_schema =
    R"({"title":"foxglove.JointStates","type":"object","properties":{)"
    R"("timestamp":{"type":"object","properties":{"sec":{"type":"integer"},"nsec":{"type":"integer"}}},)"
    R"("joints":{"type":"array","items":{"type":"object","properties":{"name":{"type":"string"},)"
    R"("position":{"type":"number"},"velocity":{"type":"number"},"acceleration":{"type":"number"},)"
    R"("effort":{"type":"number"}}}}}})";

}  // namespace

McapTable::McapTable(const std::filesystem::path& path, const std::vector<Quantity>& quantities,
                     const RunLog& log)
    : file_(path),
      quantities_(quantities),
      period_ns_(1e9 * log.info().period_s),
      joints_(log.scenario().model->joint_names) {
  for (std::string& name : joints_) name = diagnostics::json_text(nlohmann::json(name));
  for (const Slot slot : loop::all_slots) {
    std::string properties = R"("tick":{"type":"integer"})";
    for (const Quantity& each : quantities_) {
      if (each.slot != slot) continue;
      properties += fmt::format(
          R"(,"{}":{{"type":"array","items":{{"type":"number"}},"description":"{} [{}]"}})",
          each.name, each.description, fmt::join(each.units, ", "));
    }
    const std::string& topic = log.summary().of(slot).channel;
    channels_[index(slot)] =
        file_.add_channel(topic, fmt::format("tachless.{}", topic),
                          fmt::format(R"({{"type":"object","properties":{{{}}}}})", properties));
  }
  const std::string& robot = log.info().robot;
  states_ = file_.add_channel(robot + "_JOINT_STATES", joint_states, joint_states_schema);
  reference_ =
      file_.add_channel(robot + "_JOINT_STATES_REFERENCE", joint_states, joint_states_schema);
}

void McapTable::append(const TickRecord& record) {
  const auto time_ns =
      static_cast<std::uint64_t>(std::llround(static_cast<double>(record.tick) * period_ns_));
  for (const Slot slot : loop::all_slots) {
    if (!has(record, slot)) continue;
    text_ = fmt::format(R"({{"tick":{})", record.tick);
    for (const Quantity& quantity : quantities_) {
      if (quantity.slot == slot) add(quantity, record);
    }
    file_.add(channels_[index(slot)], time_ns, text_ += "}");
  }
  if (const auto& truth = record.truth) {
    add_states(states_, time_ns,
               {{"position", &truth->q}, {"velocity", &truth->v}, {"effort", &truth->tau}});
  }
  if (const auto& at = record.reference) {
    add_states(reference_, time_ns,
               {{"position", &at->q_ref}, {"velocity", &at->v_ref}, {"acceleration", &at->a_ref}});
  }
}

void McapTable::add(const Quantity& quantity, const TickRecord& record) {
  std::array<double, robot::max_joints> values;
  quantity.read(record, values.data());
  text_ += fmt::format(R"(,"{}":)", quantity.name);
  for (std::size_t i = 0; i < quantity.units.size(); ++i) {
    text_ += i == 0 ? '[' : ',';
    add_number(text_, values[i]);
  }
  text_ += ']';
}

void McapTable::add_states(
    std::uint16_t channel, std::uint64_t time_ns,
    std::initializer_list<std::pair<std::string_view, const robot::Vector*>> members) {
  text_ = fmt::format(R"({{"timestamp":{{"sec":{},"nsec":{}}},"joints":[)", time_ns / 1'000'000'000,
                      time_ns % 1'000'000'000);
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    text_ += fmt::format(R"({}{{"name":{})", i == 0 ? "" : ",", joints_[i]);
    for (const auto& [name, values] : members) {
      text_ += fmt::format(R"(,"{}":)", name);
      add_number(text_, (*values)[static_cast<Eigen::Index>(i)]);
    }
    text_ += '}';
  }
  file_.add(channel, time_ns, text_ += "]}");
}

}  // namespace tachless::logger
