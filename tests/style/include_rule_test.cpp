// Who may include what. The longest matching folder decides.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

struct Rule {
  std::string folder;                      // or file
  std::vector<std::string> ours;           // prefixes of what it may include of this repository
  std::vector<std::string> third_parties;  // prefixes; the standard library and fmt always
  bool system = false;                     // POSIX and Linux headers
};

const std::vector<std::string> anything = {""};

const std::vector<Rule> rules = {
    {"diagnostics/", {"diagnostics/"}, {"spdlog/"}},
    {"diagnostics/file_text.cpp", {"diagnostics/"}, {}, true},
    {"diagnostics/json_text.h", {}, {"nlohmann/"}},

    {"schema/", {"schema/", "robot/quantities.h"}, {"fmt/"}},

    {"robot/", {"robot/"}, {"Eigen/"}},
    {"robot/decompositions.cpp", {"robot/"}, {"Eigen/", "unsupported/Eigen/MatrixFunctions"}},
    {"robot/postures.cpp", {"robot/", "process/parallel.h"}, {"Eigen/", "nlopt.h"}},
    {"robot/urdf_text.cpp", {"robot/", "diagnostics/"}, {"tinyxml.h"}},
    {"robot/mjcf_joints.cpp", {"robot/"}, {"fmt/", "tinyxml.h"}},
    {"robot/urdf_xml.cpp", {"robot/"}, {"Eigen/", "tinyxml.h", "urdf_model/pose.h"}},

    {"loop/", {"loop/", "robot/quantities.h"}, {}},

    {"process/", {"process/", "diagnostics/"}, {}, true},

    {"bus/", {"bus/", "loop/", "process/", "robot/quantities.h"}, {"fmt/"}, true},
    {"bus/wire.cpp", {"bus/"}, {"tachless/"}},
    {"bus/truth/", {"bus/", "loop/"}, {"tachless_truth/"}},
    {"bus/udp_transport.cpp", {"bus/"}, {"lcm/"}, true},
    {"bus/authenticated.cpp", {"bus/", "loop/"}, {"sodium.h"}, true},
    {"bus/key.cpp", {"bus/", "process/", "diagnostics/failure.h"}, {"sodium.h"}, true},

    {"protocol/", {"protocol/", "loop/", "diagnostics/"}, {}},

    {"experiment/",
     {"experiment/", "plant/spec.h", "controller/law/filter.h", "reference/spec.h", "robot/",
      "schema/", "loop/measurements.h", "diagnostics/"},
     {"fmt/"}},
    {"experiment/xacro.cpp", {"experiment/", "process/child.h", "diagnostics/"}, {"fmt/"}, true},
    {"experiment/yaml_tree.cpp", {"experiment/", "diagnostics/"}, {"yaml-cpp/"}},

    {"node/",
     {"node/", "protocol/", "bus/", "experiment/", "process/", "loop/", "diagnostics/"},
     {"CLI/", "nlohmann/"},
     true},

    {"plant/",
     {"plant/", "robot/", "reference/make_trajectory.h", "node/", "protocol/", "bus/",
      "experiment/", "loop/", "diagnostics/"},
     {"Eigen/"}},
    {"plant/spec.h", {"schema/"}, {}},
    {"plant/spec.h", {"plant/spec.h", "schema/", "robot/quantities.h"}, {}},
    {"plant/simbody_multibody.cpp",
     {"plant/multibody.h", "base/elementary.h"},
     {"Eigen/", "SimTKsimbody.h"}},

    {"reference/",
     {"reference/", "robot/", "node/", "protocol/", "bus/", "experiment/", "loop/", "diagnostics/"},
     {"Eigen/", "fmt/"}},
    {"reference/spec.h", {"reference/trajectory/"}, {}},
    {"reference/trajectory/",
     {"reference/trajectory/", "loop/signals.h", "schema/", "robot/quantities.h"},
     {"Eigen/", "fmt/"}},

    {"controller/",
     {"controller/", "robot/", "node/", "protocol/", "bus/", "experiment/", "loop/", "schema/",
      "diagnostics/"},
     {"Eigen/"}},
    {"controller/law_socket.",
     {"controller/", "process/", "bus/", "experiment/gains.h", "node/run_info.h", "diagnostics/"},
     {},
     true},
    {"controller/law/", {"controller/law/", "loop/signals.h", "schema/", "robot/"}, {"Eigen/"}},
    {"controller/law/filter.h", {"schema/", "robot/quantities.h"}, {}},

    {"logger/",
     {"logger/", "node/", "protocol/", "bus/", "experiment/", "process/", "robot/", "loop/",
      "diagnostics/"},
     {"nlohmann/", "fmt/"},
     true},
    {"logger/export.cpp", {"logger/", "diagnostics/"}, {"fmt/"}, true},

    {"certificate/",
     {"certificate/", "controller/laws.h", "controller/registry.h", "controller/stepped_law.h",
      "controller/law/", "diagnostics/failure.h", "diagnostics/fnv.h", "diagnostics/text.h",
      "experiment/", "loop/measurements.h", "loop/signals.h", "plant/arm.h", "plant/plant_model.h",
      "process/parallel.h", "reference/make_trajectory.h", "robot/"},
     {"Eigen/", "nlohmann/"}},
    {"certificate/linear_programme.cpp", {"certificate/"}, {"Eigen/", "coin/"}},
    {"tuning/",
     {"tuning/", "certificate/", "controller/registry.h", "controller/law/", "experiment/",
      "loop/signals.h", "process/parallel.h", "robot/", "diagnostics/failure.h"},
     {"Eigen/", "fmt/"}},

    {"study/",
     {"study/", "robot/", "controller/registry.h", "reference/make_trajectory.h",
      "reference/trajectory/", "plant/", "experiment/", "loop/", "certificate/scenario_loop.h",
      "schema/schema.h", "diagnostics/failure.h"},
     {"Eigen/"}},
    {"study/sweep.cpp", {"study/", "process/", "diagnostics/"}, {}, true},
    {"study/sweep_plan.cpp", {"study/", "experiment/", "diagnostics/"}, {"nlohmann/"}},
    {"study/in_process_log.cpp",
     {"study/", "controller/registry.h", "node/run_info.h", "plant/truth_of.h", "bus/wire.h",
      "bus/truth/", "loop/"},
     {}},

    {"report/",
     {"report/", "certificate/", "controller/registry.h", "controller/stepped_law.h",
      "identify/least_squares.h", "logger/", "node/statistics.h", "process/", "study/",
      "experiment/", "schema/", "robot/", "loop/", "diagnostics/"},
     {"Eigen/", "nlohmann/", "sodium.h"},
     true},
    {"replay/",
     {"replay/", "study/", "controller/", "logger/", "experiment/", "robot/", "loop/",
      "diagnostics/"},
     {"nlohmann/"}},
    {"identify/",
     {"identify/", "study/", "controller/registry.h", "reference/make_trajectory.h", "logger/",
      "experiment/", "robot/", "loop/", "plant/", "process/parallel.h", "diagnostics/"},
     {"Eigen/", "nlohmann/"}},
    {"monitor/", {"monitor/", "bus/", "loop/", "diagnostics/"}, {"nlohmann/", "fmt/"}, true},
    {"monitor/live_run.",
     {"monitor/", "bus/", "logger/run_log.h", "study/tracking.h", "loop/", "diagnostics/"},
     {},
     true},
    {"launch/live_server.cpp",
     {"launch/", "report/html.h", "process/this_process.h", "diagnostics/"},
     {"httplib.h"},
     true},
    {"launch/",
     {"launch/",
      "certificate/",
      "tuning/",
      "report/",
      "replay/",
      "identify/",
      "monitor/",
      "controller/registry.h",
      "controller/law_socket.h",
      "plant/",
      "reference/",
      "logger/",
      "node/",
      "bus/",
      "experiment/",
      "process/",
      "robot/",
      "loop/",
      "diagnostics/",
      "study/"},
     {"CLI/", "nlohmann/"},
     true},

    {"python/",
     {"python/", "controller/", "experiment/", "logger/", "plant/truth_of.h", "study/", "robot/",
      "loop/", "diagnostics/"},
     {"pybind11/", "Eigen/"}},
    {"python/linear.cpp",
     {"python/", "certificate/scenario_loop.h", "controller/registry.h", "experiment/"},
     {"pybind11/"}},
    {"python/listener.cpp",
     {"python/", "bus/udp_transport.h", "monitor/bus_monitor.h", "node/options.h", "loop/",
      "diagnostics/"},
     {"pybind11/", "nlohmann/"}},

    {"tests/", anything, anything, true},
    {"bench/", anything, anything, true},
    {"examples/", anything, anything, true},
};

// Only these may see the ground truth, directly or through other headers.
const std::vector<std::string> may_see_truth = {
    "loop/truth/", "bus/truth/", "plant/",  "logger/", "study/", "report/", "replay/",
    "identify/",   "monitor/",   "launch/", "python/", "tests/", "bench/",  "examples/"};

bool starts_with_one_of(const std::string& text, const std::vector<std::string>& prefixes) {
  return std::any_of(prefixes.begin(), prefixes.end(),
                     [&](const std::string& prefix) { return text.rfind(prefix, 0) == 0; });
}

const Rule* rule_of(const std::string& file) {
  const Rule* best = nullptr;
  for (const Rule& rule : rules) {
    if (file.rfind(rule.folder, 0) == 0 &&
        (best == nullptr || rule.folder.size() > best->folder.size())) {
      best = &rule;
    }
  }
  return best;
}

struct Include {
  std::string path;
  bool angle = false;
};

std::vector<Include> includes_of(std::istream& source) {
  static const std::regex pattern(R"(^\s*#\s*include\s*([<"])([^>"]+)[>"])");
  std::vector<Include> found;
  std::string line;
  std::smatch match;
  while (std::getline(source, line)) {
    if (std::regex_search(line, match, pattern)) found.push_back({match[2], match[1] == "<"});
  }
  return found;
}

/// fmt stands for std::format, which Debian 12's compiler has not.
bool is_standard(const std::string& header) {
  if (header.starts_with("fmt/")) return true;
  return header.find('.') == std::string::npos && header.find('/') == std::string::npos;
}

bool is_system(const std::string& header) {
  static const std::set<std::string> top = {"unistd.h",  "fcntl.h",   "poll.h",   "signal.h",
                                            "sched.h",   "pthread.h", "time.h",   "spawn.h",
                                            "errno.h",   "string.h",  "dirent.h", "netdb.h",
                                            "ifaddrs.h", "termios.h", "glob.h",   "semaphore.h"};
  return top.contains(header) ||
         starts_with_one_of(header, {"sys/", "net/", "netinet/", "arpa/", "linux/"});
}

/// Why `file` may not include this; empty if it may.
std::string objection(const std::string& file, const Include& include) {
  const Rule* rule = rule_of(file);
  if (rule == nullptr) return "no rule covers this file's folder";
  if (!include.angle) {
    if (starts_with_one_of(include.path, {"tests/", "bench/"}) &&
        !starts_with_one_of(file, {"tests/", "bench/"})) {
      return "nothing includes tests or benches";
    }
    return starts_with_one_of(include.path, rule->ours) ? "" : "this room may not use that one";
  }
  if (is_standard(include.path)) return "";
  if (is_system(include.path)) {
    return rule->system || rule->third_parties == anything ? "" : "no system headers here";
  }
  return starts_with_one_of(include.path, rule->third_parties)
             ? ""
             : "this library is not for this file";
}

const fs::path root = TACHLESS_SOURCE_DIR;

std::vector<std::string> sources() {
  std::vector<std::string> files;
  for (const Rule& rule : rules) {
    if (rule.folder.back() != '/' || std::count(rule.folder.begin(), rule.folder.end(), '/') != 1 ||
        !fs::exists(root / rule.folder)) {
      continue;
    }
    for (const auto& entry : fs::recursive_directory_iterator(root / rule.folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension == ".h" || extension == ".cpp" || extension == ".in") {
        files.push_back(fs::relative(entry.path(), root).string());
      }
    }
  }
  return files;
}

std::vector<Include> includes_of_file(const std::string& file) {
  std::ifstream source(root / file);
  return includes_of(source);
}

TEST(IncludeRule, HoldsForEveryIncludeOfEveryFile) {
  const std::vector<std::string> files = sources();
  ASSERT_GT(files.size(), 50U) << "the sources were not found";
  for (const std::string& file : files) {
    for (const Include& include : includes_of_file(file)) {
      EXPECT_EQ(objection(file, include), "") << file << " includes " << include.path;
    }
  }
}

TEST(IncludeRule, EveryRoomOfTheListHasOneAndEveryRuleARoom) {
  std::ifstream list(root / "cmake/rooms.txt");
  std::set<std::string> listed;
  for (std::string line; std::getline(list, line);) {
    if (line.empty() || line.front() == '#') continue;
    listed.insert(line.substr(0, line.find(' ')) + "/");
  }
  listed.erase("lcmtypes/");  // holds no C++
  std::set<std::string> ruled;
  for (const Rule& rule : rules) ruled.insert(rule.folder.substr(0, rule.folder.find('/') + 1));
  for (const char* other : {"tests/", "bench/", "examples/"}) ruled.erase(other);
  EXPECT_EQ(listed, ruled);
}

TEST(IncludeRule, SimbodyUrdfdomAndLcmAreSeenByTheirFilesAlone) {
  std::map<std::string, std::set<std::string>> users;
  for (const std::string& file : sources()) {
    if (starts_with_one_of(file, {"tests/", "bench/", "examples/"})) continue;
    for (const Include& include : includes_of_file(file)) {
      for (const char* library : {"SimTK", "urdf_", "lcm/"}) {
        if (include.path.rfind(library, 0) == 0) users[library].insert(file);
      }
    }
  }
  const std::map<std::string, std::set<std::string>> expected = {
      {"SimTK", {"plant/simbody_multibody.cpp"}},
      {"urdf_", {"robot/urdf_xml.cpp"}},
      {"lcm/", {"bus/udp_transport.cpp"}}};
  for (const auto& [library, files] : users) EXPECT_EQ(files, expected.at(library)) << library;
}

TEST(IncludeRule, KeepsTruthFromEveryFileThatMayNotSeeItEvenThroughOtherHeaders) {
  for (const std::string& file : sources()) {
    if (starts_with_one_of(file, may_see_truth)) continue;
    std::set<std::string> seen;
    std::vector<std::string> open = {file};
    while (!open.empty()) {
      const std::string current = open.back();
      open.pop_back();
      for (const Include& include : includes_of_file(current)) {
        EXPECT_FALSE(
            starts_with_one_of(include.path, {"loop/truth/", "bus/truth/", "tachless_truth/"}))
            << file << " sees " << include.path << " through " << current;
        if (!include.angle && seen.insert(include.path).second) open.push_back(include.path);
      }
    }
  }
}

TEST(IncludeRule, EveryHeaderGuardsItself) {
  for (const std::string& file : sources()) {
    if (fs::path(file).extension() != ".h") continue;
    std::ifstream source(root / file);
    std::string text((std::istreambuf_iterator<char>(source)), {});
    EXPECT_THAT(text, HasSubstr("#pragma once")) << file;
  }
}

TEST(IncludeRule, ObjectsToWhatTheTableForbids) {
  const auto refused = [](const std::string& file, const std::string& path, bool angle) {
    return !objection(file, {path, angle}).empty();
  };
  EXPECT_TRUE(refused("controller/law/a.h", "bus/wire.h", false));
  EXPECT_TRUE(refused("controller/law/a.h", "experiment/scenario.h", false));
  EXPECT_TRUE(refused("controller/law/a.h", "unistd.h", true));
  EXPECT_TRUE(refused("controller/node.cpp", "plant/arm.h", false));
  EXPECT_TRUE(refused("controller/node.cpp", "logger/run_log.h", false));
  EXPECT_TRUE(refused("plant/node.cpp", "SimTKsimbody.h", true));
  EXPECT_TRUE(refused("robot/model.h", "experiment/scenario.h", false));
  EXPECT_TRUE(refused("robot/model.cpp", "spdlog/spdlog.h", true));
  EXPECT_TRUE(refused("protocol/tick_master.h", "bus/transport.h", false));
  EXPECT_TRUE(refused("protocol/membership.h", "bus/transport.h", false));
  EXPECT_TRUE(refused("bus/wire.cpp", "lcm/lcm-cpp.hpp", true));
  EXPECT_TRUE(refused("bus/wire.cpp", "tachless_truth/plant_truth_t.hpp", true));
  EXPECT_TRUE(refused("report/figure.cpp", "tests/robot/robots.h", false));
  EXPECT_TRUE(refused("study/a.cpp", "bus/transport.h", false));
  EXPECT_TRUE(refused("monitor/a.cpp", "report/chart.h", false));
  EXPECT_TRUE(refused("elsewhere/a.h", "robot/model.h", false));
  EXPECT_FALSE(refused("controller/law/a.h", "robot/model.h", false));
  EXPECT_FALSE(refused("controller/node.cpp", "bus/wire.h", false));
  EXPECT_FALSE(refused("plant/simbody_multibody.cpp", "SimTKsimbody.h", true));
}

}  // namespace
