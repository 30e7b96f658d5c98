#include <fmt/format.h>

#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "controller/registry.h"
#include "diagnostics/json_text.h"
#include "launch/verb.h"

namespace tachless::launch::verb {
namespace {

using controller::LawFacts;
using controller::Parameter;

struct Options {
  bool json = false;
};

std::string default_text(const Parameter& parameter) {
  return parameter.described_default.empty() ? "has a default"
                                             : std::string(parameter.described_default);
}

std::string page(const LawFacts& law) {
  std::string text = fmt::format("{}\n  measures    {}, on {} joints{}\n", law.name,
                                 law.measurement, law.needs_flexible_joints ? "flexible" : "rigid",
                                 law.regulation_only ? "; the reference has to be constant" : "");
  for (const Parameter& parameter : law.parameters) {
    text += fmt::format("  {:<17} [{}]: {}; {}{}\n", parameter.name, parameter.unit,
                        parameter.meaning, parameter.allowed,
                        parameter.required ? "" : "; if not given: " + default_text(parameter));
  }
  return text + fmt::format("  proved      {}\n  conditions  {}\n  source      {}\n", law.proved,
                            law.conditions, law.source);
}

nlohmann::ordered_json to_json(const LawFacts& law) {
  nlohmann::ordered_json json = {{"name", law.name},
                                 {"measures", law.measurement},
                                 {"joints", law.needs_flexible_joints ? "flexible" : "rigid"},
                                 {"regulation_only", law.regulation_only},
                                 {"feedforward_lead", law.has_feedforward_lead}};
  for (const Parameter& parameter : law.parameters) {
    json["parameters"].push_back({{"name", parameter.name},
                                  {"unit", parameter.unit},
                                  {"meaning", parameter.meaning},
                                  {"allowed", parameter.allowed},
                                  {"required", parameter.required}});
    if (!parameter.required) json["parameters"].back()["default"] = default_text(parameter);
  }
  for (const loop::Signal& signal : law.signals) {
    json["signals"].push_back({{"name", signal.name}, {"unit", signal.unit}});
  }
  json.update({{"proved", law.proved}, {"conditions", law.conditions}, {"source", law.source}});
  return json;
}

diagnostics::ExitCode list(const Options& options) {
  if (options.json) {
    nlohmann::ordered_json all = nlohmann::ordered_json::array();
    for (const LawFacts& law : controller::laws()) all.push_back(to_json(law));
    std::cout << diagnostics::json_text(all, 2) << "\n";
  } else {
    std::string_view gap;
    for (const LawFacts& law : controller::laws()) {
      std::cout << gap << page(law);
      gap = "\n";
    }
  }
  return diagnostics::ExitCode::done;
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  command.add_flag("--json", options->json, "As JSON");
  return [options] { return list(*options); };
}

}  // namespace

extern const Verb laws;
const Verb laws = {"laws",
                   "The control laws: what each measures, its parameters, conditions and source",
                   "  tachless laws\n"
                   "  tachless laws --json",
                   declare};

}  // namespace tachless::launch::verb
