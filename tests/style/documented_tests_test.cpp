// Each fault of docs/faults.md has a test; files that the documents name exist.

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

std::vector<fs::path> documents() {
  std::vector<fs::path> all = {root / "README.md", root / "CONTRIBUTING.md", root / "SECURITY.md"};
  for (const auto& entry : fs::recursive_directory_iterator(root / "docs")) {
    if (entry.path().extension() == ".md") all.push_back(entry.path());
  }
  return all;
}

TEST(Documents, NameTestsThatExist) {
  std::set<std::string> exist;
  for (const auto& entry : fs::recursive_directory_iterator(root / "tests")) {
    if (entry.path().extension() != ".cpp") continue;
    exist.merge(matches(contents(entry.path()),
                        std::regex(R"(TEST(?:_F|_P)?\(\s*(\w+)\s*,\s*(\w+)\s*\))")));
  }
  std::string pages;
  for (const fs::path& document : documents()) pages += contents(document);
  const std::set<std::string> named = matches(pages, std::regex(R"(`([A-Z]\w+)\.([A-Z]\w+)`)"));
  EXPECT_GT(named.size(), 40U);
  for (const std::string& each : named) EXPECT_TRUE(exist.contains(each)) << each;
}

TEST(Faults, HaveATestUnderTheirTable) {
  const std::string page = contents(root / "docs/faults.md");
  const auto numbers = [&](const char* pattern) {
    std::multiset<int> found;
    const std::regex number(pattern);
    for (std::sregex_iterator each(page.begin(), page.end(), number), end; each != end; ++each) {
      found.insert(std::stoi(each->str(1)));
    }
    return found;
  };
  const std::multiset<int> rows = numbers(R"(\n\| (\d+) \|)");
  EXPECT_GT(rows.size(), 30U);
  EXPECT_EQ(numbers(R"((\d+): `[A-Z]\w+\.)"), rows);
}

TEST(Documents, NameFilesThatExist) {
  const std::regex path(R"re(`((?:[a-z_]+/)+[\w.]+\.(?:cpp|h|md|sh|py|yaml|urdf|csv|lcm|txt))`)re");
  int found = 0;
  for (const fs::path& document : documents()) {
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
