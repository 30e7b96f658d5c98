#include "study/sweep_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/failure.h"
#include "base/json_text.h"
#include "base/text.h"
#include "scenario/motion_file.h"
#include "scenario/yaml_tree.h"

namespace tachless::study {
namespace {

using base::ExitCode;
using base::Failure;
using base::split;
using scenario::YamlNode;

constexpr int plan_version = 1;
constexpr double most_cases = 1e8;

Failure refused(const std::string& axis, std::string_view problem) {
  return {ExitCode::bad_usage, fmt::format("--vary {}: {}", axis, problem)};
}

std::optional<double> number(std::string_view text) {
  const auto value = base::number_in(text);
  return value && std::isfinite(*value) ? value : std::nullopt;
}

/// Along the axis, `share` of the way from low to high.
double between(const Axis& axis, double share) {
  if (share >= 1) return axis.high;
  if (!axis.logarithmic) return axis.low + share * (axis.high - axis.low);
  return axis.low * std::pow(axis.high / axis.low, share);
}

void read_range(Axis& axis, const std::string& range, bool drawn) {
  std::vector<std::string_view> parts = split(range, ':');
  if (parts.back() == "log") {
    axis.logarithmic = true;
    parts.pop_back();
  }
  const char* form = drawn ? "allowed with --random: KEY=from:to or KEY=from:to:log"
                           : "allowed: KEY=from:to:number, KEY=from:to:number:log, KEY=a,b,c";
  if (parts.size() != (drawn ? 2 : 3)) throw refused(axis.text, form);
  const auto low = number(parts[0]), high = number(parts[1]);
  for (const std::size_t end : {0, 1}) {
    if (!number(parts[end])) {
      throw refused(axis.text, fmt::format("\"{}\" is no number; {}", parts[end], form));
    }
  }
  if (*low > *high) {
    throw refused(axis.text, fmt::format("from {0} to {1}; write {1}:{0}", parts[0], parts[1]));
  }
  if (axis.logarithmic && *low <= 0) {
    throw refused(axis.text, fmt::format("log from {}; allowed: above 0", parts[0]));
  }
  axis.low = *low;
  axis.high = *high;
  if (drawn) return;
  const auto count = number(parts[2]);
  if (!count || *count < 1 || *count > 1e6 || *count != std::floor(*count)) {
    throw refused(axis.text,
                  fmt::format("{} values; allowed: a whole number from 1 to 1000000", parts[2]));
  }
  for (int i = 0; i < *count; ++i) {
    axis.values.push_back(between(axis, *count > 1 ? i / (*count - 1) : 0));
  }
}

/// In [0, 1), the same on every machine: splitmix64 of the three.
double drawn_share(std::uint64_t seed, std::int64_t index, std::size_t axis) {
  std::uint64_t x = seed;
  for (const std::uint64_t next : {static_cast<std::uint64_t>(index), std::uint64_t{axis}}) {
    x += 0x9e3779b97f4a7c15U + next;
    x = (x ^ (x >> 30U)) * 0xbf58476d1ce4e5b9U;
    x = (x ^ (x >> 27U)) * 0x94d049bb133111ebU;
    x ^= x >> 31U;
  }
  return static_cast<double>(x >> 11U) * 0x1p-53;
}

const YamlNode* find(const YamlNode& root, const std::string& key) {
  const YamlNode* node = &root;
  for (const std::string_view part : split(key, '.')) {
    if (node != nullptr) node = node->find(part);
  }
  return node;
}

/// "key=value" with one entry of the value replaced, or entries multiplied.
std::string changed(const YamlNode& root, const Axis& axis, double value, int num_joints) {
  const YamlNode* node = find(root, axis.key);
  const auto per_joint = static_cast<std::size_t>(axis.entry ? num_joints : 1);
  const bool single = node != nullptr && node->kind == YamlNode::Kind::scalar;
  std::vector<double> entries;
  if (single) {
    entries.assign(per_joint, number(node->scalar).value_or(NAN));
  } else if (node != nullptr && node->kind == YamlNode::Kind::list) {
    for (const YamlNode& child : node->children) {
      entries.push_back(number(child.scalar).value_or(NAN));
    }
  } else if (node == nullptr && axis.entry && !axis.factor) {
    entries.assign(per_joint, 0);
  }
  if (entries.empty() || std::ranges::any_of(entries, [](double x) { return std::isnan(x); })) {
    throw refused(
        axis.text,
        fmt::format("the scenario gives no number for {}: write one, with --set or in its file",
                    axis.key));
  }
  if (axis.entry && *axis.entry >= static_cast<int>(entries.size())) {
    throw refused(axis.text, fmt::format("entry {} of {}; allowed: 0 to {}", *axis.entry, axis.key,
                                         entries.size() - 1));
  }
  std::vector<std::string> texts;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const bool this_one = !axis.entry || *axis.entry == static_cast<int>(i);
    const double new_value = axis.factor ? entries[i] * value : value;
    texts.push_back(fmt::format("{}", this_one ? new_value : entries[i]));
  }
  const std::string list = base::joined(texts);
  return axis.key + (single && !axis.entry ? "=" + list : "=[" + list + "]");
}

}  // namespace

Axis parse_axis(const std::string& text, bool drawn) {
  Axis axis;
  axis.text = text;
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos) throw refused(text, "no '='; write KEY=from:to:number");
  axis.key = text.substr(0, equals);
  if (axis.key.ends_with('*')) {
    axis.factor = true;
    axis.key.pop_back();
  }
  if (axis.key.ends_with(']')) {
    const std::size_t open = axis.key.find('[');
    if (open == std::string::npos) throw refused(text, "no '[' before ']'; write KEY[ENTRY]=…");
    const auto entry = number(axis.key.substr(open + 1, axis.key.size() - open - 2));
    if (!entry || *entry < 0 || *entry != std::floor(*entry) || *entry > 1000) {
      throw refused(text, fmt::format("entry {}; allowed: a whole number from 0 to 1000",
                                      axis.key.substr(open)));
    }
    axis.entry = static_cast<int>(*entry);
    axis.key.resize(open);
  }
  if (axis.key.empty() || axis.key.find_first_of("[]*") != std::string::npos) {
    throw refused(text, fmt::format("the key is \"{}\"; write KEY=…, KEY[ENTRY]=… or KEY*=…",
                                    text.substr(0, equals)));
  }
  const std::string range = text.substr(equals + 1);
  if (range.find(',') == std::string::npos) {
    read_range(axis, range, drawn);
    return axis;
  }
  if (drawn) throw refused(text, "a list cannot be drawn from; write KEY=from:to");
  for (const std::string_view part : split(range, ',')) {
    const auto value = number(part);
    if (!value) throw refused(text, fmt::format("\"{}\" is no number; write KEY=a,b,c", part));
    axis.values.push_back(*value);
  }
  return axis;
}

void SweepPlan::add(Axis axis) {
  for (const Axis& other : axes) {
    if (other.key != axis.key) continue;
    if (other.entry && axis.entry && *other.entry != *axis.entry) continue;
    throw refused(axis.text, fmt::format("--vary {} varies the same number; leave one of them out",
                                         base::shell_word(other.text)));
  }
  axes.push_back(std::move(axis));
}

std::int64_t SweepPlan::cases_per_law() const {
  double cases = drawn > 0 ? static_cast<double>(drawn) : 1;
  for (const Axis& axis : axes) cases *= drawn > 0 ? 1 : static_cast<double>(axis.values.size());
  const double of_all_laws = cases * static_cast<double>(laws.size());
  if (of_all_laws > most_cases) {
    throw base::bad_usage("a sweep of {:.3g} runs; allowed: at most {:.3g}", of_all_laws,
                          most_cases);
  }
  return static_cast<std::int64_t>(cases);
}

SweepCase SweepPlan::at(std::int64_t index) const {
  const std::int64_t per_law = cases_per_law();
  SweepCase which{index, laws[static_cast<std::size_t>(index / per_law)].name, {}};
  std::int64_t rest = index % per_law;
  which.values.resize(axes.size());
  for (std::size_t i = axes.size(); i-- > 0;) {
    const Axis& axis = axes[i];
    if (drawn > 0) {
      // Laws are compared at the same draws.
      which.values[i] = between(axis, drawn_share(seed, index % per_law, i));
    } else {
      const auto count = static_cast<std::int64_t>(axis.values.size());
      which.values[i] = axis.values[static_cast<std::size_t>(rest % count)];
      rest /= count;
    }
  }
  return which;
}

scenario::Scenario SweepPlan::scenario(const SweepCase& which) const {
  const auto& law = laws[static_cast<std::size_t>(which.index / cases_per_law())];
  std::vector<std::string> overrides = law.overrides;
  YamlNode root = scenario::parse_yaml(text, source);
  for (const std::string& each : overrides) apply_override(root, each);
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const Axis& axis = axes[i];
    if (axis.factor || axis.entry) {
      overrides.push_back(changed(root, axis, which.values[i], num_joints));
    } else {
      overrides.push_back(fmt::format("{}={}", axis.key, which.values[i]));
    }
    apply_override(root, overrides.back());
  }
  if (std::ranges::find(axes, "loop.period_s", &Axis::key) != axes.end()) {
    // After all axes: one of them may be the duration.
    const YamlNode* given = find(root, "loop.duration_s");
    const double length = given != nullptr ? number(given->scalar).value_or(1) : 1;
    const double period = number(find(root, "loop.period_s")->scalar).value_or(1);
    const double ticks = std::max(1.0, std::round(length / period));
    overrides.push_back(fmt::format("loop.duration_s={:.12g}", ticks * period));
  }
  scenario::Scenario made = scenario::parse_scenario(text, urdf, source, overrides);
  scenario::read_motion(made, std::filesystem::path(source).parent_path());
  return made;
}

std::string SweepPlan::json() const {
  nlohmann::ordered_json json = {{"version", plan_version}, {"name", name}, {"source", source}};
  for (const SweepLaw& law : laws)
    json["laws"].push_back({{"law", law.name}, {"set", law.overrides}});
  json["vary"] = nlohmann::ordered_json::array();
  for (const Axis& axis : axes) json["vary"].push_back(axis.text);
  json["random"] = drawn;
  json["seed"] = seed;
  json["num_joints"] = num_joints;
  json["scenario"] = text;
  json["robot_description"] = urdf;
  return base::json_text(json, 1) + "\n";
}

SweepPlan SweepPlan::from_json(const std::string& json, const std::string& source) {
  SweepPlan plan;
  try {
    const auto read = base::parse_json(json);
    if (read.at("version") != plan_version) {
      throw base::bad_usage("{}: a plan of version {}; this program reads version {}", source,
                            base::json_text(read.at("version")), plan_version);
    }
    plan.name = read.at("name");
    plan.source = read.at("source");
    for (const auto& law : read.at("laws")) plan.laws.push_back({law.at("law"), law.at("set")});
    plan.drawn = read.at("random");
    plan.seed = read.at("seed");
    plan.num_joints = read.at("num_joints");
    for (const std::string text : read.at("vary")) {
      plan.add(parse_axis(text, plan.drawn > 0));
    }
    if (plan.laws.empty()) throw base::bad_usage("{}: not a sweep's plan: no laws", source);
    plan.text = read.at("scenario");
    plan.urdf = read.at("robot_description");
  } catch (const nlohmann::json::exception& problem) {
    throw base::bad_usage("{}: not a sweep's plan: {}", source, problem.what());
  }
  return plan;
}

}  // namespace tachless::study
