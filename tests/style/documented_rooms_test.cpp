// CONTRIBUTING.md's table of rooms is cmake/rooms.txt, and every room's folder has what its line
// promises.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

const fs::path root = TACHLESS_SOURCE_DIR;

struct Room {
  std::string name;
  std::string purpose;
};

std::vector<Room> listed() {
  std::ifstream file(root / "cmake/rooms.txt");
  const std::regex row(R"(([a-z]+) +(.+))");
  std::vector<Room> rooms;
  std::smatch match;
  for (std::string line; std::getline(file, line);) {
    if (std::regex_match(line, match, row)) rooms.push_back({match[1], match[2]});
  }
  return rooms;
}

TEST(Rooms, TableInContributingIsTheListThatTheBuildReads) {
  std::ifstream file(root / "CONTRIBUTING.md");
  const std::string page((std::istreambuf_iterator<char>(file)), {});
  std::string table = "| room | what is there |\n|---|---|\n";
  for (const Room& room : listed()) table += "| `" + room.name + "/` | " + room.purpose + " |\n";
  EXPECT_THAT(page, testing::HasSubstr(table)) << "the table has to read:\n" << table;
}

TEST(Rooms, AreFoldersWithATargetOfTheirOwn) {
  ASSERT_GT(listed().size(), 15U);
  for (const Room& room : listed()) {
    EXPECT_TRUE(fs::exists(root / room.name / "CMakeLists.txt")) << room.name;
  }
}

TEST(Rooms, HaveTheirTestsUnderTheirOwnName) {
  for (const auto& entry : fs::directory_iterator(root / "tests")) {
    if (!entry.is_directory()) continue;
    const std::string name = entry.path().filename();
    const std::vector<std::string> others = {"campaign", "fuzz",  "golden",  "model",
                                             "mutation", "style", "support", "system"};
    const auto rooms = listed();
    const bool is_room = std::any_of(rooms.begin(), rooms.end(),
                                     [&](const Room& room) { return room.name == name; });
    EXPECT_TRUE(is_room || std::find(others.begin(), others.end(), name) != others.end())
        << "tests/" << name << " is no room's";
  }
}

}  // namespace
