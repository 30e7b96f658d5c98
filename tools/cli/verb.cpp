// Functions that the verbs share: options, output, names and texts of the scenarios that they
// write.

#include "cli/verb.h"

#include <CLI/CLI.hpp>
#include <cctype>
#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>
#include <variant>

#include "base/file_text.h"
#include "base/json_text.h"
#include "base/logging.h"
#include "base/text.h"
#include "cli/run.h"
#include "controller/registry.h"
#include "scenario/model_pin.h"
#include "scenario/scenario.h"
#include "scenario/yaml_tree.h"

namespace tachless::cli {

void add_json(CLI::App& command, bool& json) { command.add_flag("--json", json, "Prints JSON"); }
void add_quiet(CLI::App& command, bool& quiet) {
  command.add_flag("-q,--quiet", quiet, "No progress on stderr");
}

std::string above_zero(const std::string& text) {
  const double number = base::number_in(text).value_or(0);
  return number > 0 && std::isfinite(number) ? "" : text + "; allowed: a number above 0";
}

void print_text(std::string_view text) {
  const auto lines = base::split(text, '\n');
  for (std::size_t i = 0; i < lines.size(); ++i) {
    std::cout << (i > 0 ? "\n" : "") << base::printable(lines[i]);
  }
}

void print(bool json, nlohmann::ordered_json all, const std::string& text) {
  all["text"] = text;
  if (json) {
    std::cout << base::json_text(all, 2) << "\n";
  } else {
    print_text(text);
  }
}

void require_writable(const std::filesystem::path& file, bool force) {
  if (file.empty()) return;
  if (!force && std::filesystem::exists(file)) {
    throw base::bad_usage("{}: exists already; name another file, or replace it with --force",
                          file.string());
  }
  base::UnfinishedFile(file, "name another file");
}

bool is_yaml(const std::filesystem::path& file) {
  return file.extension() == ".yaml" || file.extension() == ".yml";
}

void require_scenario_writable(const std::filesystem::path& file, bool force) {
  if (file.empty() || is_yaml(file)) return require_writable(file, force);
  throw base::bad_usage("{}: --write makes a scenario; allowed: a name that ends with .yaml",
                        file.string());
}

std::string scenario_name(const std::filesystem::path& file) {
  std::string name = file.stem().string().substr(0, 100);
  for (char& c : name) {
    const bool first = &c == name.data();
    const bool letter = std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_';
    if (!letter && (first || (c != '.' && c != '-'))) c = '_';
  }
  return name;
}

std::string path_from(const std::filesystem::path& output, const std::filesystem::path& file) {
  using std::filesystem::absolute;
  const std::filesystem::path whole = absolute(file).lexically_normal();
  if (output.empty()) return whole.string();
  return whole.lexically_relative(absolute(output).lexically_normal().parent_path()).string();
}

std::string text_for(const std::filesystem::path& output, const scenario::Scenario& scenario,
                     const std::filesystem::path& input) {
  scenario::YamlNode root = scenario::parse_yaml(scenario.text, scenario.source);
  const auto move = [&](std::string_view key, const std::string& path) {
    const std::string moved = path_from(output, input.parent_path() / path);
    scenario::apply_override(root, scenario::text_override(key, moved));
  };
  move("robot.urdf", scenario.robot.urdf_path);
  if (scenario.believed_model) move("controller.urdf", scenario.controller.urdf_path);
  if (const std::string& model = scenario.plant.mujoco.model; !model.empty()) {
    move("plant.mujoco.model", scenario::without_digest(model));
  }
  using reference::trajectory::MotionFile;
  if (const auto* const motion = std::get_if<MotionFile>(&scenario.reference)) {
    move("reference.file.path", motion->path);
  }
  return scenario::emit_yaml(root);
}

void write_scenario(const std::filesystem::path& input, std::vector<std::string> overrides,
                    const std::vector<std::string>& changes, const std::filesystem::path& output) {
  overrides.insert(overrides.end(), changes.begin(), changes.end());
  overrides.push_back("name=" + scenario_name(output));
  const scenario::Scenario changed = scenario::load_scenario(input, overrides);
  base::UnfinishedFile(output, write_remedy).write(text_for(output, changed, input));
}

void warn(const scenario::Scenario& scenario) {
  (void)controller::law_facts(scenario);
  for (const std::string& warning : scenario.model->warnings) base::log_warning(warning);
}

Vector one_a_joint(std::string_view option, const std::vector<double>& given, int joints) {
  if (given.size() > 1 && std::ssize(given) != joints) {
    throw base::bad_usage("{} has {} numbers; allowed: 1, or {}, one a joint", option, given.size(),
                          joints);
  }
  Vector all(joints);
  for (int i = 0; i < joints; ++i) {
    all[i] = given[given.size() == 1 ? 0 : static_cast<std::size_t>(i)];
  }
  return all;
}

std::vector<std::string> of_program(const std::filesystem::path& scenario,
                                    std::vector<std::string> overrides,
                                    const std::string& law_program) {
  RunOptions options;
  options.scenario = scenario;
  options.overrides = std::move(overrides);
  options.law_program = law_program;
  options.measurement = measurement_wanted(options);
  options.overrides.clear();
  return options.all_overrides();
}

}  // namespace tachless::cli
