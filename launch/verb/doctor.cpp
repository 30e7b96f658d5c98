#include <fmt/format.h>

#include <algorithm>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "diagnostics/json_text.h"
#include "launch/doctor.h"
#include "launch/verb.h"
#include "node/options.h"

namespace tachless::launch::verb {
namespace {

struct Options {
  std::string lcm_url = node::default_lcm_url;
  bool json = false;
};

void print(const std::vector<Finding>& findings) {
  for (const Finding& finding : findings) {
    std::cout << fmt::format("{:<4} {:<20}{}\n", finding.ok ? "ok" : "--", finding.subject,
                             finding.what);
    if (finding.remedy) std::cout << "     type: " << *finding.remedy << "\n";
  }
}

void print_json(const std::vector<Finding>& findings) {
  auto list = nlohmann::ordered_json::array();
  for (const Finding& finding : findings) {
    list.push_back({{"subject", finding.subject},
                    {"ok", finding.ok},
                    {"what", finding.what},
                    {"remedy", finding.remedy ? nlohmann::ordered_json(*finding.remedy)
                                              : nlohmann::ordered_json()}});
  }
  std::cout << diagnostics::json_text(list, 2) << "\n";
}

Verb::Action declare(CLI::App& command) {
  auto options = std::make_shared<Options>();
  node::add_lcm_url(command, options->lcm_url);
  command.add_flag("--json", options->json, "As JSON");
  return [options] {
    const std::vector<Finding> findings = examine(options->lcm_url, ".");
    if (options->json) {
      print_json(findings);
    } else {
      print(findings);
    }
    const bool well = std::all_of(findings.begin(), findings.end(),
                                  [](const Finding& finding) { return finding.ok; });
    return well ? diagnostics::ExitCode::done : diagnostics::ExitCode::check_said_no;
  };
}

}  // namespace

extern const Verb doctor;
const Verb doctor = {"doctor", "Is this machine fit? Each line says ok, or what to type",
                     "  tachless doctor\n"
                     "  tachless doctor --json\n"
                     "  tachless doctor --lcm-url 'udpm://239.255.76.67:7700?ttl=1'\n"
                     "Exit code 0 when all is well, 1 when a line says what to type.",
                     declare};

}  // namespace tachless::launch::verb
