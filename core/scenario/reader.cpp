#include "scenario/reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "base/text.h"
#include "scenario/key_paths.h"

namespace tachless::scenario {
namespace {

bool is_plain(const YamlNode& node) { return node.kind == YamlNode::Kind::scalar && !node.quoted; }

template <class Number>
void read_number(const Written& written, Number& to) {
  const YamlNode& node = written.node;
  const char* begin = node.scalar.data();
  const char* const end = begin + node.scalar.size();
  const bool plus = node.scalar.starts_with('+') && !node.scalar.starts_with("+-");
  if (std::is_floating_point_v<Number> && plus) ++begin;
  const auto [stop, error] = std::from_chars(begin, end, to);
  if (!is_plain(node) || error != std::errc{} || stop != end ||
      !written.range.contains(static_cast<double>(to))) {
    throw InvalidValue{emit_line(node)};
  }
}

template <class Entry>
void read_list(const Written& written, std::vector<Entry>& to) {
  const YamlNode& list = written.node;
  if (list.kind != YamlNode::Kind::list) throw InvalidValue{emit_line(list)};
  for (const YamlNode& entry : list.children) {
    try {
      read_value({entry, written.range, written.num_joints}, to.emplace_back());
    } catch (const InvalidValue& refused) {
      const std::string value = emit_line(entry);
      throw InvalidValue{fmt::format("entry {} of {} is {}", to.size(), emit_line(list), value) +
                         (refused.value == value ? "" : ": " + refused.value)};
    }
  }
}

/// Returns the paths of a scenario's keys that end in this name, at most three. The deeper ones are
/// left out: they are of one kind of reference, say.
std::vector<std::string> paths_to(std::string_view name) {
  std::vector<std::string> found;
  for_each_path<Scenario>("", [&](const std::string& path, const auto&... /*key*/) {
    const bool ends = path == name || path.ends_with("." + std::string(name));
    if (ends) found.push_back(path);
  });
  const auto depth = [](const std::string& path) { return std::ranges::count(path, '.'); };
  if (found.empty()) return found;
  const auto least = depth(std::ranges::min(found, {}, depth));
  std::erase_if(found, [&](const std::string& path) { return depth(path) > least; });
  if (found.size() > 3) found.resize(3);
  return found;
}

/// Returns true if the map at `place`, which may have the keys `names`, is part of a scenario.
/// Other files are read with the same functions.
bool is_of_scenario(const Place& place, const std::vector<std::string_view>& names) {
  if (place.path.empty()) return std::ranges::find(names, "robot") != names.end();
  bool found = false;
  base::for_each_key<Scenario>([&](const auto& key) {
    found = found || place.path.substr(0, place.path.find('.')) == key.name;
  });
  return found;
}

}  // namespace

Place Place::child(std::string_view name) const {
  if (node != nullptr && node->kind != YamlNode::Kind::map) {
    throw complaint(emit_line(*node) + "; allowed: a map");
  }
  return {scenario, node == nullptr ? nullptr : node->find(name),
          path.empty() ? std::string(name) : fmt::format("{}.{}", path, name)};
}

void read_value(const Written& written, std::string& to) {
  to = written.node.scalar;
  if (to.empty()) throw InvalidValue{emit_line(written.node)};
}

void read_value(const Written& written, bool& to) {
  to = written.node.scalar == "true";
  if (!is_plain(written.node) || (!to && written.node.scalar != "false")) {
    throw InvalidValue{emit_line(written.node)};
  }
}

void read_value(const Written& written, double& to) { read_number(written, to); }
void read_value(const Written& written, std::int64_t& to) { read_number(written, to); }

void read_value(const Written& written, Vector& to) {
  const YamlNode& node = written.node;
  if (node.kind != YamlNode::Kind::list) {
    double each = 0;
    read_value(written, each);
    to = Vector::Constant(written.num_joints, each);
    return;
  }
  if (static_cast<int>(node.children.size()) != written.num_joints) {
    throw InvalidValue{fmt::format("{} has length {}, the robot has {} joints", emit_line(node),
                                   node.children.size(), written.num_joints)};
  }
  std::vector<double> numbers;
  read_value(written, numbers);
  to = Eigen::Map<const Eigen::VectorXd>(numbers.data(), written.num_joints);
}

void read_vector_or_matrix(const Written& written, Vector& to) {
  const auto& rows = written.node.children;
  const int n = written.num_joints;
  if (rows.empty() || rows[0].kind != YamlNode::Kind::list) return read_value(written, to);
  std::vector<Vector> matrix;
  read_value(written, matrix);
  if (static_cast<int>(matrix.size()) != n || n * n > max_joints) {
    throw InvalidValue{fmt::format("{} is a matrix of {} rows, the robot has {} joints{}",
                                   emit_line(written.node), matrix.size(), n,
                                   n * n > max_joints ? ", too many for matrices" : "")};
  }
  to.resize(n * n);
  for (int i = 0; i < n; ++i) to.segment(i * n, n) = matrix[static_cast<std::size_t>(i)];
}

void read_value(const Written& written, std::vector<double>& to) { read_list(written, to); }
void read_value(const Written& written, std::vector<Vector>& to) { read_list(written, to); }

void require_known(const Place& place, const std::vector<std::string_view>& names) {
  if (place.node == nullptr || place.node->kind != YamlNode::Kind::map) return;
  for (const std::string& key : place.node->keys) {
    if (std::ranges::find(names, key) != names.end()) continue;
    const std::string place_text = place.path.empty() ? "a scenario" : place.path;
    std::string known = fmt::format("known keys of {}: {}", place_text, base::joined(names));
    if (const auto near = base::nearest(key, names)) {
      known = fmt::format("nearest known key is {}{}{}", place.path, place.path.empty() ? "" : ".",
                          *near);
    } else if (is_of_scenario(place, names)) {
      const std::vector<std::string> elsewhere = paths_to(key);
      if (!elsewhere.empty()) known = "known here: " + base::joined(elsewhere, " or ");
    }
    throw place.child(key).complaint("unknown; " + known);
  }
}

std::string_view read_alternative(const Place& place, const std::vector<std::string_view>& names,
                                  bool first_by_name) {
  const YamlNode* const node = place.node;
  if (first_by_name && (node == nullptr ||
                        (node->kind == YamlNode::Kind::scalar && node->scalar == names.front()))) {
    return names.front();
  }
  if (node != nullptr && node->kind != YamlNode::Kind::map) throw InvalidValue{emit_line(*node)};
  require_known(place, names);
  std::string_view found;
  for (const std::string_view name : names) {
    if (node == nullptr || node->find(name) == nullptr) continue;
    if (!found.empty()) {
      throw place.complaint(fmt::format("both {} and {}; allowed: one kind only", found, name));
    }
    found = name;
  }
  if (found.empty()) {
    throw place.complaint("no kind is given; allowed: exactly one of " + base::joined(names));
  }
  return found;
}

}  // namespace tachless::scenario
