// `tachless spy`: what its jar holds, and that lcm-spy starts with it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>

#include "tests/support/private_network.h"
#include "tests/support/program.h"
#include "tests/support/shell.h"

namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

/// An X server without a screen, DISPLAY of this process and its children.
class VirtualDisplay {
 public:
  explicit VirtualDisplay(const TemporaryDirectory& directory)
      : server_("Xvfb", {"-displayfd", "1", "-nolisten", "tcp", "-noreset"}, directory.path()) {
    wait_until("the X server", [&] {
      if (!server_.running()) throw std::runtime_error("Xvfb: " + server_.errors());
      return server_.output().find('\n') != std::string::npos;
    });
    setenv("DISPLAY", (":" + std::to_string(std::stoi(server_.output()))).c_str(), 1);
  }

 private:
  Program server_;
};

TEST(Spy, ItsJarHoldsAClassForEveryMessageType) {
  const auto listed =
      tachless::support::shell("jar tf " TACHLESS_BINARY_DIR "/share/tachless/tachless_types.jar");
  ASSERT_EQ(listed.exit_code, 0) << listed.output;
  int types = 0;
  for (const auto& file : fs::directory_iterator(TACHLESS_SOURCE_DIR "/lcmtypes")) {
    std::string name = file.path().stem();  // tachless_tick_t, tachless_truth_plant_truth_t
    if (file.path().extension() != ".lcm") continue;
    const auto package = name.starts_with("tachless_truth_") ? name.find('_', 9) : name.find('_');
    name[package] = '/';
    EXPECT_THAT(listed.output, HasSubstr("\n" + name + ".class\n"));
    ++types;
  }
  EXPECT_GT(types, 5);
}

TEST(Spy, StartsAndFindsTheTypes) {
  const TemporaryDirectory directory;
  const VirtualDisplay display(directory);
  Program spy("tachless", {"spy"}, directory.path());
  wait_until("lcm-spy to list its types", [&] {
    if (!spy.running()) throw std::runtime_error(spy.errors() + spy.output());
    return spy.output().find("LCM types") != std::string::npos;
  });
  const auto types = std::count_if(
      fs::directory_iterator(TACHLESS_SOURCE_DIR "/lcmtypes"), fs::directory_iterator(),
      [](const auto& file) { return file.path().extension() == ".lcm"; });
  EXPECT_THAT(spy.output(), HasSubstr("Found " + std::to_string(types) + " LCM types"));
  spy.signal(SIGTERM);
  spy.wait();
}

TEST(Spy, WithoutADisplaySaysSoInOneLine) {
  const TemporaryDirectory directory;
  setenv("DISPLAY", "", 1);
  Program spy("tachless", {"spy"}, directory.path());
  EXPECT_EQ(spy.wait(), 2);
  const std::string errors = spy.errors();
  EXPECT_THAT(errors, AllOf(HasSubstr("spy: no display: "), HasSubstr("tachless watch")));
  EXPECT_EQ(std::count(errors.begin(), errors.end(), '\n'), 1);
}

TEST(Spy, NamesThePackageThatIsMissing) {
  const TemporaryDirectory directory;
  const VirtualDisplay display(directory);
  fs::create_directories(directory / "jre/bin");
  setenv("PATH", (directory / "jre/bin").c_str(), 1);
  Program none("tachless", {"spy"}, directory.path());
  EXPECT_EQ(none.wait(), 2);
  EXPECT_THAT(none.errors(),
              HasSubstr("there is no java; as root, type: apt-get install default-jre"));
  fs::copy_file("/bin/true", directory / "jre/bin/java");  // a runtime without windows
  Program headless("tachless", {"spy"}, directory.path());
  EXPECT_EQ(headless.wait(), 2);
  EXPECT_THAT(headless.errors(), AllOf(HasSubstr("without windows"), HasSubstr("default-jre")));
}

}  // namespace
