// Which libraries a target ends up with, by what CMake was told: build/…/link_graph.txt. Who may
// include what is include_rule_test.cpp's.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

using Graph = std::map<std::string, std::vector<std::string>>;

Graph link_graph() {
  Graph graph;
  std::ifstream file(TACHLESS_BINARY_DIR "/link_graph.txt");
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    std::string target;
    words >> target;
    if (target.empty()) continue;
    target.pop_back();  // the colon
    std::vector<std::string>& libraries = graph[target];
    for (std::string library; words >> library;) libraries.push_back(library);
  }
  return graph;
}

/// All that `target` is linked with, through whatever library.
std::set<std::string> linked_with(const Graph& graph, const std::string& target) {
  std::set<std::string> seen;
  std::vector<std::string> open = {target};
  while (!open.empty()) {
    const auto found = graph.find(open.back());
    open.pop_back();
    if (found == graph.end()) continue;  // not ours
    for (const std::string& library : found->second) {
      if (seen.insert(library).second) open.push_back(library);
    }
  }
  return seen;
}

TEST(LinkGraph, KeepsFromATargetWhatItDoesNotUse) {
  struct Rule {
    std::string target;
    std::vector<std::string> without;  // parts of a library's name
  };
  const std::string simbody = "SimTK";
  const std::string hdf5 = "libhdf5";
  const std::string sockets = "bus_transport";
  const std::string truth = "truth";  // bus_truth and lcmtypes_truth
  const std::vector<Rule> rules = {
      {"controller_law", {"bus_", "experiment", "protocol_", "process", "diagnostics", "yaml"}},
      {"protocol_lockstep", {"bus_", "loop", "process"}},
      {"protocol_realtime", {"bus_", "loop", "process"}},
      {"protocol_membership", {"bus_", "process"}},
      {"experiment", {"bus_", "process", "node", "protocol_", simbody}},
      {"node", {truth, simbody, hdf5, "logger_"}},
      {"reference", {truth, simbody, hdf5, "logger_"}},
      {"controller", {truth, simbody, hdf5, "plant", "logger_runs", "logger_info"}},
      {"tachless-controller", {truth, simbody, hdf5, "plant", "logger_runs"}},
      {"plant", {hdf5, "logger_", "controller"}},
      {"logger_log", {"bus_", "experiment", "robot"}},
      {"logger_runs", {simbody, hdf5, sockets, "node", "nlohmann"}},
      {"logger_info", {simbody, hdf5, sockets, "node"}},
      {"logger_export", {simbody, sockets, "node"}},
      {"logger_node", {simbody, hdf5, "logger_runs", "logger_info"}},
      {"certificate_scenario", {"bus_", "process", "node", "logger_", simbody}},
      {"certificate_numbers", {"bus_", "process", "experiment", "diagnostics", simbody}},
      {"study", {"bus_", "protocol_", "process", "node", "logger_", hdf5, "Lcm::lcm"}},
      {"study_sweep", {"bus_", "protocol_", "process", "node", "logger_", hdf5, "Lcm::lcm"}},
      {"study_log", {sockets, "protocol_", "process", "node", "logger_", hdf5}},
      // Of node/, the counters' file alone: whoever links all of it has node_options.
      {"report", {simbody, hdf5, sockets, "node_options", "protocol_"}},
      {"replay", {simbody, hdf5, sockets, "node_options", "protocol_", "plant"}},
      {"monitor", {simbody, hdf5, "experiment", "node", "logger_"}},
      {"viewer_window", {"bus_", "process", "node", "experiment"}},
      {"viewer", {simbody, hdf5, "logger_", "controller"}},
      {"tachless-visualizer", {hdf5, "logger_", "controller"}},
  };
  const Graph graph = link_graph();
  for (const Rule& rule : rules) {
    ASSERT_TRUE(graph.contains(rule.target)) << "no target " << rule.target;
    for (const std::string& library : linked_with(graph, rule.target)) {
      for (const std::string& part : rule.without) {
        EXPECT_THAT(library, Not(HasSubstr(part))) << rule.target << " is linked with it";
      }
    }
  }
}

// Otherwise the rules above could keep out what is called something else.
TEST(LinkGraph, HasWhatTheRulesKeepOutWhereItIsUsed) {
  const Graph graph = link_graph();
  const auto with = [&](const std::string& target) { return linked_with(graph, target); };
  EXPECT_THAT(with("tachless-plant"), Contains(HasSubstr("SimTK")));
  EXPECT_THAT(with("tachless"), Contains(HasSubstr("libhdf5")));
  EXPECT_THAT(with("tachless-controller"), Contains("bus_transport"));
  EXPECT_THAT(with("tachless-controller"), Contains("logger_log"));
  EXPECT_THAT(with("tachless-logger"), Contains("lcmtypes_truth"));
  EXPECT_THAT(with("tachless-logger"), Contains("Lcm::lcm"));
  EXPECT_THAT(with("logger_info"), Contains("logger_runs"));
  EXPECT_THAT(with("launch"), Contains("node"));
  EXPECT_THAT(with("experiment"), Contains(HasSubstr("yaml")));
}

TEST(LinkGraph, HasEveryRoom) {
  const Graph graph = link_graph();
  std::ifstream list(TACHLESS_SOURCE_DIR "/cmake/rooms.txt");
  int rooms = 0;
  for (std::string line; std::getline(list, line);) {
    if (line.empty() || line.front() == '#') continue;
    const std::string room = line.substr(0, line.find(' '));
    const auto next = graph.lower_bound(room);
    EXPECT_TRUE(next != graph.end() && next->first.starts_with(room)) << room;
    ++rooms;
  }
  EXPECT_GT(rooms, 15);
}

}  // namespace
