// The rule of includes. A library includes libraries that stand before it in `order`. A program
// does not include another program. `exceptions` names every other include; an exception that no
// file needs fails too.

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
using Names = std::set<std::string>;

const fs::path root = TACHLESS_SOURCE_DIR;

const std::vector<std::string> order = {
    "base",       "robot",     "messages",   "bus",      "scenario", "session",  // core
    "plant",      "reference", "controller", "logger",                          // the four programs
    "in_process", "numerics",  "linear",     "lyapunov", "certify",  "design",  // analysis
    "study",      "identify",  "replay",     "own_loop", "report",   "live",
    "commission", "cli",  // tools
    "python"};
const Names programs = {"plant", "reference", "controller", "logger"};

/// File and header, with the reason beside each.
const std::set<std::pair<std::string, std::string>> exceptions = {
    // These headers declare data and keys. A key is thereby declared once, beside the part that
    // reads it.
    {"core/scenario/scenario.h", "plant/spec.h"},
    {"core/scenario/scenario.h", "reference/spec.h"},
    {"core/scenario/scenario.h", "controller/spec.h"},
    // The guard computes the following error from the true reference, not from a peer's message.
    {"plant/guarded_robot.h", "reference/make_trajectory.h"}};

/// Third-party headers with few users, by the beginning of their names, and the folders or files
/// that may use them.
const std::map<std::string, Names> users = {
    {"CLI/", {"core/session", "tools/cli"}},
    {"SimTKsimbody.h", {"plant/simbody_multibody.cpp"}},
    {"coin/", {"analysis/numerics"}},
    {"franka/", {"plant/drivers/franka"}},
    {"lcm/", {}},
    {"mujoco/", {"plant/mujoco/module.cpp"}},
    {"nlopt.h", {"analysis/numerics/postures.cpp"}},
    {"pybind11/", {"python"}},
    {"sodium.h", {"core/bus", "tools/report"}},
    {"spdlog/", {"core/base/logging.cpp"}},
    {"tachless/", {"core/messages/wire.cpp"}},
    {"tachless_truth/", {"core/messages/truth"}},
    {"tinyxml2.h", {"core/robot"}},
    {"unsupported/", {"analysis/numerics/decompositions.cpp"}},
    {"ur_client_library/", {"plant/drivers/ur"}},
    {"yaml-cpp/", {"core/scenario/yaml_tree.cpp"}}};

/// Libraries that may include the ground truth, directly or through other headers.
const Names see_truth = {"plant",  "logger", "in_process", "study", "identify", "replay",
                         "report", "live",   "commission", "cli",   "python"};

bool starts_with(const std::string& text, const std::string& prefix) {
  return text.rfind(prefix, 0) == 0;
}

/// Returns the library of a file of the tree: "robot" for core/robot/model.h.
std::string library_of(const std::string& file) {
  const fs::path path(file);
  auto part = path.begin();
  if (*part == "core" || *part == "analysis" || *part == "tools") ++part;
  return part->string();
}

std::size_t place(const std::string& library) {
  return static_cast<std::size_t>(std::find(order.begin(), order.end(), library) - order.begin());
}

struct Include {
  std::string path;
  bool angle = false;
};

std::vector<Include> includes_of(const std::string& file) {
  static const std::regex pattern(R"(^\s*#\s*include\s*([<"])([^>"]+)[>"])");
  std::ifstream source(root / file);
  std::vector<Include> found;
  std::string line;
  std::smatch match;
  while (std::getline(source, line)) {
    if (std::regex_search(line, match, pattern)) found.push_back({match[2], match[1] == "<"});
  }
  return found;
}

/// Returns why `file` may not include the header; empty if it may.
std::string objection(const std::string& file, const Include& include) {
  const std::string me = library_of(file);
  if (place(me) == order.size()) return "no library of this name";
  if (include.angle) {
    for (const auto& [header, allowed] : users) {
      if (starts_with(include.path, header) &&
          std::ranges::none_of(allowed, [&](const std::string& name) {
            return file == name || starts_with(file, name + "/");
          })) {
        return "only some files use this library";
      }
    }
    return "";
  }
  if (exceptions.contains({file, include.path})) return "";
  const std::string other = include.path.substr(0, include.path.find('/'));
  if (place(other) == order.size())
    return "no library of this name, or more than its folder in the path";
  if (place(other) > place(me)) return me + " stands before " + other;
  if (me != other && programs.contains(me) && programs.contains(other)) {
    return "a program includes no other program";
  }
  return "";
}

std::vector<std::string> sources() {
  std::vector<std::string> files;
  for (const char* folder :
       {"core", "plant", "reference", "controller", "logger", "analysis", "tools", "python"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension == ".h" || extension == ".cpp" || extension == ".in") {
        files.push_back(fs::relative(entry.path(), root).string());
      }
    }
  }
  return files;
}

TEST(IncludeRule, HoldsForEveryIncludeOfEveryFile) {
  const std::vector<std::string> files = sources();
  ASSERT_GT(files.size(), 300U) << "the sources were not found";
  for (const std::string& file : files) {
    for (const Include& include : includes_of(file)) {
      EXPECT_EQ(objection(file, include), "") << file << " includes " << include.path;
    }
  }
}

TEST(IncludeRule, EveryExceptionAndEveryPermissionIsUsed) {
  auto unused = exceptions;
  std::map<std::string, Names> unused_users = users;
  for (const std::string& file : sources()) {
    for (const Include& include : includes_of(file)) {
      unused.erase({file, include.path});
      for (auto& [header, allowed] : unused_users) {
        if (!include.angle || !starts_with(include.path, header)) continue;
        std::erase_if(allowed, [&](const std::string& name) {
          return file == name || starts_with(file, name + "/");
        });
      }
    }
  }
  EXPECT_THAT(unused, testing::IsEmpty());
  for (const auto& [header, allowed] : unused_users) {
    EXPECT_THAT(allowed, testing::IsEmpty()) << header;
  }
}

TEST(IncludeRule, EveryFolderOfLibrariesIsInTheOrder) {
  Names found = programs;
  found.insert("python");
  for (const char* district : {"core", "analysis", "tools"}) {
    for (const auto& entry : fs::directory_iterator(root / district)) {
      if (entry.is_directory()) found.insert(entry.path().filename().string());
    }
  }
  EXPECT_EQ(found, Names(order.begin(), order.end()));
}

TEST(IncludeRule, KeepsTruthFromEveryFileThatMayNotSeeItEvenThroughOtherHeaders) {
  const auto file_of = [](const std::string& header) {
    for (const char* district : {"core/", "analysis/", "tools/", ""}) {
      if (fs::exists(root / (district + header))) return district + header;
    }
    return header;
  };
  for (const std::string& file : sources()) {
    if (see_truth.contains(library_of(file)) || starts_with(file, "core/messages/truth/")) continue;
    Names seen;
    std::vector<std::string> open = {file};
    while (!open.empty()) {
      const std::string current = open.back();
      open.pop_back();
      for (const Include& include : includes_of(current)) {
        EXPECT_FALSE(starts_with(include.path, "messages/truth/") ||
                     starts_with(include.path, "tachless_truth/"))
            << file << " sees " << include.path << " through " << current;
        const std::string header = file_of(include.path);
        if (!include.angle && seen.insert(header).second) open.push_back(header);
      }
    }
  }
}

TEST(IncludeRule, EveryHeaderGuardsItself) {
  for (const std::string& file : sources()) {
    if (fs::path(file).extension() != ".h") continue;
    std::ifstream source(root / file);
    const std::string text((std::istreambuf_iterator<char>(source)), {});
    EXPECT_THAT(text, HasSubstr("#pragma once")) << file;
  }
}

TEST(IncludeRule, ObjectsToWhatItForbids) {
  const auto refused = [](const std::string& file, const std::string& path, bool angle = false) {
    return !objection(file, {path, angle}).empty();
  };
  EXPECT_TRUE(refused("core/robot/model.h", "scenario/scenario.h"));
  EXPECT_TRUE(refused("core/robot/model.h", "core/base/text.h"));
  EXPECT_TRUE(refused("core/scenario/reader.h", "plant/spec.h"));
  EXPECT_TRUE(refused("controller/node.cpp", "plant/arm.h"));
  EXPECT_TRUE(refused("controller/node.cpp", "linear/linear_loop.h"));
  EXPECT_TRUE(refused("analysis/linear/a.cpp", "certify/certify.h"));
  EXPECT_TRUE(refused("tools/report/figure.cpp", "tests/core/robot/robots.h"));
  EXPECT_TRUE(refused("plant/node.cpp", "SimTKsimbody.h", true));
  EXPECT_TRUE(refused("core/robot/model.cpp", "spdlog/spdlog.h", true));
  EXPECT_TRUE(refused("core/messages/wire.cpp", "tachless_truth/plant_truth_t.hpp", true));
  EXPECT_FALSE(refused("controller/law/a.h", "robot/model.h"));
  EXPECT_FALSE(refused("analysis/certify/a.h", "linear/linear_loop.h"));
  EXPECT_FALSE(refused("plant/simbody_multibody.cpp", "SimTKsimbody.h", true));
}

}  // namespace
