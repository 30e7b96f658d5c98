#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "bus/lcm_url.h"
#include "bus/network_check.h"
#include "launch/verb.h"
#include "node/options.h"
#include "process/child.h"
#include "process/display.h"
#include "process/installation.h"

namespace tachless::launch::verb {
namespace {

namespace fs = std::filesystem;

constexpr const char* chart_jar = "/usr/share/java/jchart2d.jar";

[[noreturn]] void refuse(const std::string& why) { throw diagnostics::bad_usage("spy: {}", why); }

/// The java of the search path that can open windows.
fs::path find_java() {
  const std::optional<fs::path> java = process::find_program("java");
  if (!java) refuse("there is no java; as root, type: apt-get install default-jre");
  std::error_code error;
  const fs::path home = fs::canonical(*java, error).parent_path().parent_path();
  if (!error && !fs::exists(home / "lib/libawt_xawt.so", error)) {
    refuse(
        fmt::format("{} is one without windows (in {}); as root, type: apt-get install default-jre",
                    java->string(), home.string()));
  }
  return *java;
}

std::string class_path() {
  const fs::path types = process::shared_directory() / "tachless_types.jar";
  for (const auto& [jar, remedy] :
       {std::pair<fs::path, const char*>{LCM_JAR, "as root, type: apt-get install liblcm-java"},
        {chart_jar, "as root, type: apt-get install libjchart2d-java"},
        {types, "build the target tachless_types_jar"}}) {
    if (!fs::exists(jar)) refuse(fmt::format("there is no {}; {}", jar.string(), remedy));
  }
  return fmt::format("{}:{}:{}", LCM_JAR, chart_jar, types.string());
}

diagnostics::ExitCode spy_on(const std::string& lcm_url) {
  const bus::LcmUrl url = node::parse_lcm_url(lcm_url);
  if (const auto problem = process::display_problem()) {
    refuse(fmt::format("{}, or see the same in a terminal: tachless watch", *problem));
  }
  if (const auto problem = bus::check_network(url)) {
    refuse(fmt::format("{}; to mend it, type: {}", problem->what, problem->remedy));
  }
  // Not Debian's own lcm-spy: it passes options that its Java does not know any more, and does not
  // find the chart library.
  process::become({find_java().string(), "-Djava.net.preferIPv4Stack=true", "-ea", "-cp",
                   class_path(), "lcm.spy.Spy", "-l", url.text()},
                  "as root, type: apt-get install default-jre");
}

Verb::Action declare(CLI::App& command) {
  auto lcm_url = std::make_shared<std::string>(node::default_lcm_url);
  node::add_lcm_url(command, *lcm_url);
  return [lcm_url] { return spy_on(*lcm_url); };
}

}  // namespace

extern const Verb spy;
const Verb spy = {"spy",
                  "lcm-spy with our message types, in a window; `watch` is the same in a terminal",
                  "  tachless spy\n"
                  "  tachless spy --lcm-url 'udpm://239.255.76.67:7700?ttl=0'",
                  declare};

}  // namespace tachless::launch::verb
