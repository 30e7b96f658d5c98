// The script at the root of the repository, in a copy of the tree's skeleton, with stand-ins for
// dpkg-query, apt-get, cmake and the built command: what it asks of them, and when.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "tests/support/shell.h"
#include "tests/support/temporary_directory.h"

namespace {

namespace fs = std::filesystem;
using tachless::support::Outcome;
using tachless::support::shell;
using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;

class Script : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directories(root_);
    fs::create_directories(tools_);
    fs::copy(TACHLESS_SOURCE_DIR "/tachless", root_ / "tachless");
    std::ofstream(root_ / "CMakeLists.txt") << "project(tachless VERSION 1.2.3 LANGUAGES CXX)\n";
    std::ofstream(root_ / "main.cpp") << "\n";
    tool("dpkg-query", "shift 2; for p in \"$@\"; do echo -n \"installed:$p \"; done");
    tool("apt-get", "exit 0");
    tool("sudo", "exec \"$@\"");
    // Configuring leaves a build.ninja, building a command that says how it was called.
    tool("cmake",
         "case $1 in\n"
         "--build) [ -e \"$ROOT/broken\" ] && { echo 'main.cpp:1: error: broken'; exit 1; }\n"
         "  mkdir -p $2/bin\n"
         "  printf '#!/bin/sh\\necho \"built command: $*\"\\nexit 7\\n' >$2/bin/tachless\n"
         "  chmod +x $2/bin/tachless ;;\n"
         "*) mkdir -p $ROOT/build/$4; touch $ROOT/build/$4/build.ninja;\n"
         "   for each in $5 $6; do echo ${each#-D}; done | sed s/=/:BOOL=/"
         " >$ROOT/build/$4/CMakeCache.txt ;;\n"
         "esac");
    tool("unshare", "shift; while [ \"$1\" = true ]; do exit 0; done; exec \"$@\"");
    tool("ip", "exit 0");
  }

  void tool(const std::string& name, const std::string& body) {
    const fs::path path = tools_ / name;
    std::ofstream(path) << "#!/bin/sh\necho \"" << name << " $*\" >>\"$CALLS\"\n" << body << "\n";
    fs::permissions(path, fs::perms::owner_all);
  }

  Outcome run(const std::string& arguments, const std::string& program = "") {
    const std::string script = program.empty() ? (root_ / "tachless").string() : program;
    fs::remove(calls_path());
    const std::string command = "cd / && ROOT=" + root_.string() +
                                " CALLS=" + calls_path().string() + " PATH=" + tools_.string() +
                                ":$PATH " + script + " " + arguments + " </dev/null";
    return shell(command);
  }

  [[nodiscard]] fs::path calls_path() const { return root_.parent_path() / "calls"; }
  [[nodiscard]] std::string calls() const {
    std::ostringstream text;
    text << std::ifstream(calls_path()).rdbuf();
    return text.str();
  }

  TemporaryDirectory directory_;
  fs::path root_ = directory_ / "tree";
  fs::path tools_ = directory_ / "tools";
};

TEST_F(Script, BuildsOnceAndHandsOver) {
  const Outcome first = run("run 'two words' --json");
  EXPECT_EQ(first.exit_code, 7) << "the built command's own exit code";
  EXPECT_THAT(first.output, HasSubstr("built command: run two words --json"));
  EXPECT_THAT(calls(), AllOf(HasSubstr("cmake -S " + root_.string() + " --preset release"),
                             HasSubstr("cmake --build")));
  const Outcome second = run("info log");
  EXPECT_EQ(second.output, "built command: info log\n");
  EXPECT_THAT(calls(), Not(HasSubstr("cmake -")));
}

TEST_F(Script, BuildsAgainWhenASourceIsNewer) {
  run("info log");
  fs::last_write_time(root_ / "main.cpp", fs::file_time_type::clock::now() + std::chrono::hours(1));
  run("info log");
  EXPECT_THAT(calls(), AllOf(HasSubstr("cmake --build"), Not(HasSubstr("--preset"))));
}

TEST_F(Script, WorksThroughASymbolicLink) {
  const fs::path link = root_.parent_path() / "link";
  fs::create_symlink(root_ / "tachless", link);
  EXPECT_THAT(run("info log", link.string()).output, HasSubstr("built command: info log"));
}

TEST_F(Script, InstallsWhatIsMissingAndNamesIt) {
  tool("dpkg-query",
       "shift 2; for p in \"$@\"; do [ $p = gnuplot-nox ] || echo -n \"installed:$p \"; done");
  const Outcome outcome = run("info log");
  EXPECT_THAT(outcome.output,
              HasSubstr("installing the Debian packages that are missing: gnuplot-nox\n"));
  EXPECT_THAT(calls(), HasSubstr("--no-install-recommends gnuplot-nox\n"));
}

TEST_F(Script, CallsNoPackageManagerWhenNothingIsMissing) {
  run("info log");
  EXPECT_THAT(calls(), Not(HasSubstr("apt-get")));
}

TEST_F(Script, SaysSoWhenPackagesCannotBeInstalled) {
  tool("dpkg-query", "exit 0");
  tool("apt-get", "echo 'E: no network'; exit 100");
  const Outcome outcome = run("info log");
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.output,
              AllOf(HasSubstr("E: no network"), HasSubstr("apt-get could not install")));
}

TEST_F(Script, ShowsWhyABuildFailed) {
  std::ofstream(root_ / "broken") << "\n";
  const Outcome outcome = run("info log");
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.output,
              AllOf(HasSubstr("main.cpp:1: error: broken"), HasSubstr("build/release/build.log")));
  fs::remove(root_ / "broken");
  EXPECT_THAT(run("info log").output, HasSubstr("built command: info log"));
}

TEST_F(Script, AnswersVersionAndHelpWithoutBuilding) {
  EXPECT_EQ(run("--version").output, "tachless 1.2.3\n");
  EXPECT_THAT(run("run --help").output, HasSubstr("./tachless test"));
  EXPECT_EQ(calls(), "");
  run("info log");
  EXPECT_EQ(run("run --help").output, "built command: run --help\n");
  EXPECT_EQ(calls(), "");
}

TEST_F(Script, TestOfEverythingBuildsWithoutWarningsAndAlsoTestsUnderBothSanitizers) {
  tool("ctest", "echo '100% tests passed, 0 tests failed out of 2'");
  EXPECT_EQ(run("test").exit_code, 0);
  const auto configured = [](const std::string& preset) {
    return HasSubstr("--preset " + preset +
                     " -DTACHLESS_TESTS=ON -DCMAKE_COMPILE_WARNING_AS_ERROR=ON\n");
  };
  EXPECT_THAT(calls(), AllOf(configured("release"), configured("asan-ubsan"), configured("tsan")));
  const std::string build = "cmake --build " + root_.string() + "/build/";
  const std::string test = "ctest --test-dir " + root_.string() + "/build/";
  const std::string how = " --parallel 2 --output-on-failure";
  EXPECT_THAT(calls(), AllOf(HasSubstr(build + "release --target all\n"),
                             HasSubstr(build + "asan-ubsan --target fast_tests\n"),
                             HasSubstr(build + "tsan --target thread_tests\n")));
  EXPECT_THAT(calls(), AllOf(HasSubstr(test + "release" + how + "\n"),
                             HasSubstr(test + "asan-ubsan" + how + " -L ^fast$\n"),
                             HasSubstr(test + "tsan" + how + " -L ^threads$\n")));
}

TEST_F(Script, TestOfASelectionIsOfOnePreset) {
  tool("ctest", "echo '100% tests passed, 0 tests failed out of 2'");
  EXPECT_THAT(run("test --label bus").output, EndsWith("\n2 passed, 0 failed\n"));
  EXPECT_THAT(run("test --preset tsan").output, EndsWith("\n2 passed, 0 failed\n"));
}

TEST_F(Script, SoakBuildsItsProgramAndHandsOver) {
  tool("cmake",
       "[ $1 = --build ] || { mkdir -p $ROOT/build/$4; exit 0; }\n"
       "mkdir -p $2/bin; printf '#!/bin/sh\\necho \"soak: $*\"\\nexit 1\\n' >$2/bin/$4\n"
       "chmod +x $2/bin/$4");
  const Outcome outcome = run("soak --rounds 1");
  EXPECT_EQ(outcome.exit_code, 1) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr("soak: --rounds 1\n"));
  EXPECT_THAT(calls(), HasSubstr("--target tachless-soak\n"));
  EXPECT_EQ(run("soak --help").output, "soak: --help\n");
}

TEST_F(Script, PackageBuildsWhatIsPackedAndNamesThePackages) {
  tool("cpack", "mkdir -p $ROOT/build/package; touch $ROOT/build/package/a.deb");
  const Outcome outcome = run("package");
  EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, EndsWith("/build/package/a.deb\n"));
  EXPECT_THAT(calls(), AllOf(HasSubstr("--target package_files\n"),
                             HasSubstr("cpack --config " + root_.string() +
                                       "/build/release/CPackConfig.cmake\n")));
  tool("cpack", "exit 1");
  EXPECT_EQ(run("package").exit_code, 2);
}

TEST_F(Script, TestEndsWithTheCountAlone) {
  tool("ctest", "echo '96% tests passed, 1 tests failed out of 25'; exit 8");
  const Outcome failed = run("test");
  EXPECT_EQ(failed.exit_code, 1);
  EXPECT_THAT(failed.output, EndsWith("\n72 passed, 3 failed\n"));
  tool("ctest", "echo '100% tests passed, 0 tests failed out of 25'");
  const Outcome passed = run("test");
  EXPECT_EQ(passed.exit_code, 0);
  EXPECT_THAT(passed.output, EndsWith("\n75 passed, 0 failed\n"));
}

TEST_F(Script, TestFailsWhenThereIsNothingToCount) {
  tool("ctest", "echo 'No tests were found!!!'");
  EXPECT_EQ(run("test nothing").exit_code, 1);
  tool("ctest", "exit 139");
  const Outcome crashed = run("test --preset release");
  EXPECT_EQ(crashed.exit_code, 1);
  EXPECT_THAT(crashed.output, EndsWith("0 passed, 1 failed\n"));
}

TEST_F(Script, TestPassesSelectionOnAndRunsInAPrivateNetwork) {
  tool("ctest", "echo '100% tests passed, 0 tests failed out of 2'");
  EXPECT_EQ(run("test --label launch --preset asan-ubsan test_a test_b").exit_code, 0);
  EXPECT_THAT(calls(), AllOf(HasSubstr("unshare -rn"), HasSubstr("-L launch -R test_a|test_b"),
                             HasSubstr("--preset asan-ubsan"), HasSubstr("ip link set lo up")));
}

TEST_F(Script, TestRefusesAPresetThatIsNotThere) {
  const Outcome outcome = run("test --preset fast");
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.output, HasSubstr("must be dev, release, asan-ubsan or tsan"));
}

TEST_F(Script, TestOfABrokenTreeCountsTheBuildAsFailed) {
  std::ofstream(root_ / "broken") << "\n";
  const Outcome outcome = run("test");
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.output, EndsWith("\n0 passed, 3 failed\n")) << "one for each preset";
}

}  // namespace
