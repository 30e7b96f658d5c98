// Sizes: every hand-written file of the rooms and the script, by docs/style.md and decision 0019.
// Functions: readability-function-size in .clang-tidy.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

constexpr std::size_t max_lines_of_a_file = 400;
constexpr std::size_t max_lines = 50'300;  // of all rooms together

struct Source {
  std::string path;
  std::size_t lines = 0;
};

std::vector<Source> sources() {
  const fs::path root = TACHLESS_SOURCE_DIR;
  const std::set<std::string> written_by_hand = {".cpp",  ".h",   ".py",  ".js", ".css",
                                                 ".html", ".lcm", ".inc", ".in", ".cmake"};
  std::vector<Source> all;
  const auto add = [&](const fs::path& path) {
    std::ifstream file(path);
    Source source{path.lexically_relative(root)};
    for (std::string line; std::getline(file, line);) ++source.lines;
    all.push_back(source);
  };
  std::vector<std::string> folders = {"cmake", "bench", "examples"};
  std::ifstream rooms(root / "cmake/rooms.txt");
  for (std::string row; std::getline(rooms, row);) {
    if (!row.empty() && row.front() != '#') folders.push_back(row.substr(0, row.find(' ')));
  }
  for (const std::string& folder : folders) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      if (written_by_hand.contains(entry.path().extension()) ||
          entry.path().filename() == "CMakeLists.txt") {
        add(entry.path());
      }
    }
  }
  add(root / "tachless");
  add(root / "CMakeLists.txt");
  add(root / "setup.py");
  return all;
}

TEST(Size, NoFileHasMoreThan400Lines) {
  ASSERT_GT(sources().size(), 100U);
  for (const Source& source : sources())
    EXPECT_LE(source.lines, max_lines_of_a_file) << source.path;
}

TEST(Size, TheProductIsNoLargerThanDecidedAndNoRoomAbove13Percent) {
  std::map<std::string, std::size_t> rooms;
  std::size_t lines = 0;
  for (const Source& source : sources()) {
    rooms[source.path.substr(0, source.path.find('/'))] += source.lines;
    lines += source.lines;
  }
  for (const auto& [room, of_room] : rooms) {
    std::cout << of_room << " " << room << "\n";
    EXPECT_LE(of_room, lines * 13 / 100) << room;
  }
  std::cout << lines << " lines in all\n";
  EXPECT_LE(lines, max_lines) << "of the product; see docs/decisions/0019-size.md";
}

}  // namespace
