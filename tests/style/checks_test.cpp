// The checks of style must find the faults that they are made for.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "tests/support/shell.h"
#include "tests/support/temporary_directory.h"

namespace {

using tachless::support::Outcome;
using ::testing::HasSubstr;
using ::testing::Not;

const std::string root = TACHLESS_SOURCE_DIR;

/// A source tree of two files under this project's rules, with the files of its build.
class AFile : public ::testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::create_directories(directory_ / "plant");
    for (const char* rules : {".clang-tidy", ".clang-format"}) {
      std::filesystem::copy(root + "/" + rules, directory_ / rules);
    }
    std::filesystem::create_directories(directory_ / "build");
    std::filesystem::create_directories(directory_ / "cmake");
    write("build/build.ninja", "");
    std::string commands;
    for (const std::string name : {"a", "b"}) {
      const std::string file = directory_ / ("plant/" + name + ".cpp");
      commands += (commands.empty() ? "[\n{\n" : ",\n{\n");
      commands += "  \"directory\": \"" + directory_.path().string() + "\",\n";
      commands += "  \"command\": \"c++ -std=c++20 -o " + name + ".cpp.o -c " + file + "\",\n";
      commands += "  \"file\": \"" + file + "\"\n}";
      write("plant/" + name + ".cpp", "");
    }
    write("build/compile_commands.json", commands + "\n]\n");
  }

  void write(const std::string& name, const std::string& text) {
    std::ofstream(directory_ / name) << text;
  }
  [[nodiscard]] Outcome clang_tidy() const {
    return tachless::support::shell(root + "/tests/style/clang_tidy.sh " +
                                    directory_.path().string() + " " +
                                    (directory_ / "build").string());
  }
  [[nodiscard]] Outcome clang_format() const {
    return tachless::support::shell(root + "/tests/style/clang_format.sh " +
                                    directory_.path().string());
  }

 private:
  TemporaryDirectory directory_;
};

TEST_F(AFile, ThatClangTidyObjectsToFailsEveryTime) {
  write("plant/a.cpp", "int BadlyNamed() { return 1; }\nint wellNamed = 2;\n");
  for (int i = 0; i < 2; ++i) {
    const Outcome outcome = clang_tidy();
    EXPECT_NE(outcome.exit_code, 0);
    EXPECT_THAT(outcome.output, HasSubstr("invalid case style for variable 'wellNamed'"));
    EXPECT_THAT(outcome.output, HasSubstr("clang-tidy objects to plant/a.cpp"));
  }
}

TEST_F(AFile, ThatPassedIsLookedAtAgainOnceItChanges) {
  write("plant/a.cpp", "int well_named = 2;\n");
  for (int i = 0; i < 2; ++i) EXPECT_EQ(clang_tidy().exit_code, 0) << clang_tidy().output;
  write("plant/a.cpp", "int wellNamed = 2;\n");
  EXPECT_NE(clang_tidy().exit_code, 0);
}

TEST_F(AFile, MayHaveTheNamesOfAnother) {
  for (const char* name : {"plant/a.cpp", "plant/b.cpp"}) {
    write(name, "namespace {\nint same = 1;\n}\nint main() { return same; }\n");
  }
  EXPECT_EQ(clang_tidy().exit_code, 0) << clang_tidy().output;
  write("plant/b.cpp", "namespace {\nint same = 1, notTheSame = 2;\n}\n");
  const Outcome outcome = clang_tidy();
  EXPECT_NE(outcome.exit_code, 0);
  EXPECT_THAT(outcome.output, HasSubstr("clang-tidy objects to plant/b.cpp"));
  EXPECT_THAT(outcome.output, Not(HasSubstr("plant/a.cpp")));
}

TEST_F(AFile, ThatClangFormatWouldWriteDifferentlyFails) {
  write("plant/a.cpp", "int well_named = 2;\n");
  EXPECT_EQ(clang_format().exit_code, 0) << clang_format().output;
  write("plant/a.cpp", "int  well_named=2;\n");
  EXPECT_NE(clang_format().exit_code, 0);
}

}  // namespace
