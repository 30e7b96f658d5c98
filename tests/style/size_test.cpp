// How large the product may become: files by the rule of docs/style.md, and all of it by decision
// 0019. Functions: readability-function-size in .clang-tidy.

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

constexpr std::size_t most_lines_of_a_file = 400;
// Of all rooms together. Who needs more takes something out first, or changes the decision.
constexpr std::size_t most_lines = 39'500;

struct Source {
  std::string path;
  std::size_t lines = 0;
  std::string first_line;
};

std::vector<Source> sources() {
  const fs::path root = TACHLESS_SOURCE_DIR;
  std::ifstream rooms(root / "cmake/rooms.txt");
  std::vector<Source> all;
  for (std::string row; std::getline(rooms, row);) {
    if (row.empty() || row.front() == '#') continue;
    for (const auto& entry :
         fs::recursive_directory_iterator(root / row.substr(0, row.find(' ')))) {
      const std::string ending = entry.path().extension();
      if (ending != ".cpp" && ending != ".h" && ending != ".py") continue;
      Source source{entry.path().lexically_relative(root), 0, ""};
      std::ifstream file(entry.path());
      for (std::string line; std::getline(file, line); ++source.lines) {
        if (source.lines == 0) source.first_line = line;
      }
      all.push_back(source);
    }
  }
  return all;
}

TEST(Size, AFileOfMoreThan400LinesBeginsWithTheReason) {
  ASSERT_GT(sources().size(), 100U);
  for (const Source& source : sources()) {
    EXPECT_TRUE(source.lines <= most_lines_of_a_file ||
                source.first_line.find("More than 400 lines: ") != std::string::npos)
        << source.path << " has " << source.lines
        << " lines; split it by concept, or begin it with \"// More than 400 lines: \" and why";
  }
}

TEST(Size, TheProductIsNoLargerThanDecided) {
  std::map<std::string, std::size_t> rooms;
  std::size_t lines = 0;
  for (const Source& source : sources()) {
    rooms[source.path.substr(0, source.path.find('/'))] += source.lines;
    lines += source.lines;
  }
  std::string table;
  for (const auto& [room, of_room] : rooms) table += room + " " + std::to_string(of_room) + "\n";
  EXPECT_LE(lines, most_lines) << "by room:\n" << table;
  EXPECT_GT(lines, most_lines * 95 / 100) << "smaller: lower the bound here; by room:\n" << table;
}

}  // namespace
