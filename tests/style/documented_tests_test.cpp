// A fault that docs/operations.md promises an outcome for has the test that it names; files that
// the documents name exist.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

const fs::path root = TACHLESS_SOURCE_DIR;

std::string contents(const fs::path& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::set<std::string> matches(const std::string& text, const std::regex& pattern) {
  std::set<std::string> found;
  for (std::sregex_iterator each(text.begin(), text.end(), pattern), end; each != end; ++each) {
    found.insert(each->str(1) + "." + each->str(2));
  }
  return found;
}

TEST(Operations, NamesTestsThatExist) {
  std::set<std::string> exist;
  for (const auto& entry : fs::recursive_directory_iterator(root / "tests")) {
    if (entry.path().extension() != ".cpp") continue;
    exist.merge(matches(contents(entry.path()),
                        std::regex(R"(TEST(?:_F|_P)?\(\s*(\w+)\s*,\s*(\w+)\s*\))")));
  }
  const std::set<std::string> named =
      matches(contents(root / "docs/operations.md"), std::regex(R"(`([A-Z]\w+)\.([A-Z]\w+)`)"));
  EXPECT_GT(named.size(), 40U);
  for (const std::string& each : named) EXPECT_TRUE(exist.contains(each)) << each;
}

TEST(Operations, NamesATestInEveryRowOfItsTables) {
  std::ifstream file(root / "docs/operations.md");
  const std::regex a_test(R"(`[A-Z]\w+\.[A-Z]\w+`)");
  bool in_faults = false;
  int rows = 0;
  std::string line;
  while (std::getline(file, line)) {
    if (line.rfind("## ", 0) == 0) in_faults = line == "## Faults";
    const bool row = line.rfind("| ", 0) == 0 && line.rfind("| fault ", 0) != 0;
    if (!in_faults || !row) continue;
    ++rows;
    EXPECT_TRUE(std::regex_search(line, a_test)) << line;
  }
  EXPECT_GT(rows, 30);
}

TEST(Documents, NameFilesThatExist) {
  std::vector<fs::path> documents = {root / "README.md", root / "CONTRIBUTING.md"};
  for (const auto& entry : fs::recursive_directory_iterator(root / "docs")) {
    if (entry.path().extension() == ".md") documents.push_back(entry.path());
  }
  const std::regex path(R"re(`((?:[a-z_]+/)+[\w.]+\.(?:cpp|h|md|sh|py|yaml|urdf|csv|lcm|txt))`)re");
  int found = 0;
  for (const fs::path& document : documents) {
    const std::string text = contents(document);
    for (std::sregex_iterator each(text.begin(), text.end(), path), end; each != end; ++each) {
      const std::string name = each->str(1);
      if (name.starts_with("out/") || name.starts_with("build/")) continue;  // written by programs
      ++found;
      EXPECT_TRUE(fs::exists(root / name)) << document << " names " << name;
    }
  }
  EXPECT_GT(found, 20);
}

TEST(Decisions, AreAllInTheirIndex) {
  const std::string index = contents(root / "docs/decisions/README.md");
  for (const auto& entry : fs::directory_iterator(root / "docs/decisions")) {
    const std::string name = entry.path().filename();
    if (name == "README.md") continue;
    EXPECT_NE(index.find("](" + name + ") | "), std::string::npos) << name;
  }
}

}  // namespace
