#include "experiment/reader.h"

#include <fmt/format.h>

#include <charconv>

#include "diagnostics/text.h"

namespace tachless::experiment {
namespace {

/// The number that all of `node` is; nothing when it is none or outside `range`.
template <class Number>
std::optional<Number> number_in(const YamlNode& node, const schema::Range& range) {
  if (node.kind != YamlNode::Kind::scalar || node.quoted) return std::nullopt;
  Number number{};
  const char* begin = node.scalar.data();
  const char* const end = begin + node.scalar.size();
  if (std::is_floating_point_v<Number> && begin != end && *begin == '+') ++begin;
  const auto [stop, error] = std::from_chars(begin, end, number);
  if (error != std::errc{} || stop != end || !range.contains(static_cast<double>(number))) {
    return std::nullopt;
  }
  return number;
}

std::string entry_text(const YamlNode& list, std::size_t i) {
  return fmt::format("entry {} of {} is {}", i + 1, emit_line(list), emit_line(list.children[i]));
}

const YamlNode& as_list(const YamlNode& node) {
  if (node.kind != YamlNode::Kind::list) throw Refused{emit_line(node)};
  return node;
}

}  // namespace

Place Place::child(std::string_view name) const {
  if (node != nullptr && node->kind != YamlNode::Kind::map) {
    throw complaint(emit_line(*node) + "; allowed: a map");
  }
  return {scenario, node == nullptr ? nullptr : node->find(name),
          path.empty() ? std::string(name) : fmt::format("{}.{}", path, name)};
}

std::string read_text(const YamlNode& node) {
  if (node.kind != YamlNode::Kind::scalar || node.scalar.empty()) throw Refused{emit_line(node)};
  return node.scalar;
}

double read_number(const YamlNode& node, const schema::Range& range) {
  if (const auto number = number_in<double>(node, range)) return *number;
  throw Refused{emit_line(node)};
}

std::int64_t read_whole(const YamlNode& node, const schema::Range& range) {
  if (const auto number = number_in<std::int64_t>(node, range)) return *number;
  throw Refused{emit_line(node)};
}

bool read_yes_no(const YamlNode& node) {
  if (node.kind == YamlNode::Kind::scalar && !node.quoted) {
    if (node.scalar == "true") return true;
    if (node.scalar == "false") return false;
  }
  throw Refused{emit_line(node)};
}

std::vector<double> read_numbers(const YamlNode& node, const schema::Range& range) {
  std::vector<double> numbers;
  for (const YamlNode& entry : as_list(node).children) {
    const auto number = number_in<double>(entry, range);
    if (!number) throw Refused{entry_text(node, numbers.size())};
    numbers.push_back(*number);
  }
  return numbers;
}

robot::Vector read_joints(const YamlNode& node, const schema::Range& range, int num_joints) {
  if (node.kind != YamlNode::Kind::list) {
    return robot::Vector::Constant(num_joints, read_number(node, range));
  }
  if (static_cast<int>(node.children.size()) != num_joints) {
    throw Refused{fmt::format("{} has length {}, the robot has {} joints", emit_line(node),
                              node.children.size(), num_joints)};
  }
  const std::vector<double> numbers = read_numbers(node, range);
  return Eigen::Map<const Eigen::VectorXd>(numbers.data(), num_joints);
}

std::vector<robot::Vector> read_joints_list(const YamlNode& node, const schema::Range& range,
                                            int num_joints) {
  std::vector<robot::Vector> vectors;
  for (const YamlNode& entry : as_list(node).children) {
    try {
      vectors.push_back(read_joints(entry, range, num_joints));
    } catch (const Refused& refused) {
      const std::string value = emit_line(entry);
      throw Refused{entry_text(node, vectors.size()) +
                    (refused.value == value ? "" : ": " + refused.value)};
    }
  }
  return vectors;
}

std::string_view only_one(const Place& place, const std::vector<std::string_view>& names) {
  std::string_view found;
  for (const std::string_view name : names) {
    if (place.node == nullptr || place.node->find(name) == nullptr) continue;
    if (!found.empty()) {
      throw place.complaint(fmt::format("both {} and {}; allowed: one kind only", found, name));
    }
    found = name;
  }
  if (found.empty()) {
    throw place.complaint("no kind is given; allowed: exactly one of " +
                          diagnostics::joined(names));
  }
  return found;
}

}  // namespace tachless::experiment
