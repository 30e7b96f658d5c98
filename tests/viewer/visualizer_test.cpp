// `tachless run --visualize`, in a network and on a display of their own. The pictures stay in
// build/…/artefacts/visualize.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <regex>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "process/process_tree.h"
#include "tests/support/private_network.h"
#include "tests/support/process_facts.h"
#include "tests/support/program.h"
#include "tests/support/virtual_display.h"

using namespace tachless;

namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;
using Clock = std::chrono::steady_clock;

namespace fs = std::filesystem;

fs::path screenshot(const std::string& name) {
  const fs::path folder = TACHLESS_BINARY_DIR "/artefacts/visualize";
  fs::create_directories(folder);
  return folder / name;
}

std::vector<std::string> run_of(const TemporaryDirectory& directory, const std::string& scenario,
                                const std::vector<std::string>& more) {
  std::vector<std::string> words = {"run", TACHLESS_SOURCE_DIR "/scenarios/" + scenario + ".yaml",
                                    "--out", directory / "out"};
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

/// A realtime run that no busy machine ends.
std::vector<std::string> on_the_wall_clock(const std::string& duration_s) {
  return {"--mode",     "realtime",
          "--duration", duration_s,
          "--set",      "loop.max_missed=1000",
          "--set",      "loop.max_missed_share=1",
          "--quiet"};
}

/// A run with its window.
class Visualized {
 public:
  Visualized(const TemporaryDirectory& directory, const VirtualDisplay& display,
             const std::string& scenario, std::vector<std::string> more)
      : title_("tachless: " + scenario),
        log_(directory / "out/lcmlog"),
        display_(display),
        program_("tachless", (more.push_back("--visualize"), run_of(directory, scenario, more)),
                 directory.path()) {
    wait_for("the window", [&] { return (window_ = display_.window(title_)).has_value(); });
  }

  /// Until Ctrl-C, which is all that ends it.
  void expect_that_it_goes_on() {
    const auto size = [&] {
      std::error_code absent;
      const auto bytes = fs::file_size(log_, absent);
      return absent ? 0 : bytes;
    };
    const auto before = size();
    wait_for("the log to grow", [&] { return size() > before + 200'000; });
    program_.signal(SIGINT);
    EXPECT_EQ(program_.wait(seconds(20)), 130) << program_.errors();
    EXPECT_THAT(program_.errors(), HasSubstr("tachless: interrupted"));
    EXPECT_THAT(contents(log_.parent_path() / "summary.json"),
                HasSubstr("\"fault\": \"interrupted\""));
  }

  void wait_for_the_run() {
    wait_for("the run to begin", [&] { return process("tachless-plant") != 0; });
  }

  Program& program() { return program_; }
  [[nodiscard]] const std::string& window() const { return *window_; }
  [[nodiscard]] bool shown() const { return display_.window(title_).has_value(); }

  /// The process of that name among the run's; 0 when there is none.
  [[nodiscard]] pid_t process(const std::string& name) const {
    for (const pid_t pid : process::children_of(program_.pid())) {
      if (support::program_of(pid) == name) return pid;
    }
    return 0;
  }

 private:
  void wait_for(const std::string& what, const std::function<bool()>& is_so) {
    wait_until(what, [&] {
      if (!program_.running()) throw std::runtime_error(program_.errors() + program_.output());
      return is_so();
    });
  }

  std::string title_;
  fs::path log_;
  const VirtualDisplay& display_;
  Program program_;
  std::optional<std::string> window_;
};

/// Which pixels of a picture have a colour.
struct Pixels {
  std::vector<bool> mask;
  int count = 0;
};
using IsIt = bool (*)(int red, int green, int blue);
Pixels pixels_in(const fs::path& picture, const TemporaryDirectory& directory, IsIt is_it) {
  const fs::path raw = directory / "pixels.rgb";
  // Below the line with the time, which is orange too.
  output_of("convert",
            {picture, "-gravity", "North", "-chop", "0x40", "-depth", "8", "rgb:" + raw.string()},
            directory);
  const std::string bytes = contents(raw);
  const auto byte = [&](std::size_t i) { return int{static_cast<std::uint8_t>(bytes[i])}; };
  Pixels pixels;
  for (std::size_t i = 0; i + 2 < bytes.size(); i += 3) {
    pixels.mask.push_back(is_it(byte(i), byte(i + 1), byte(i + 2)));
    pixels.count += pixels.mask.back() ? 1 : 0;
  }
  return pixels;
}

bool is_orange(int red, int green, int blue) {
  return red > 60 && red > 5 * blue && 4 * red > 5 * green;
}
Pixels links_in(const fs::path& picture, const TemporaryDirectory& directory) {
  return pixels_in(picture, directory, is_orange);
}

int differing(const Pixels& a, const Pixels& b) {
  int count = 0;
  for (std::size_t i = 0; i < a.mask.size(); ++i) count += a.mask[i] != b.mask[i] ? 1 : 0;
  return count;
}

/// The simulated time that a picture shows [s]; none when what was read is not of the form that the
/// window writes (of the 1000 times from 3 s to 4 s, tesseract reads one wrong: 3.511 as 3.5171).
std::optional<double> time_in(const fs::path& picture, const TemporaryDirectory& directory) {
  const fs::path part = directory / "time.png";
  output_of("convert", {picture, "-crop", "190x36+0+0", "+repage", part}, directory);
  const std::string text = text_in(part, directory);
  std::smatch shown_s;
  if (!std::regex_search(text, shown_s, std::regex(R"(^Time: *(\d+\.\d{3})\s*$)"))) return {};
  return std::stod(shown_s[1]);
}

class ShowsARobot : public ::testing::TestWithParam<const char*> {};

TEST_P(ShowsARobot, MovingAtTheSimulatedPaceToTheEnd) {
  const TemporaryDirectory directory;
  const VirtualDisplay display(directory);
  const auto begun = Clock::now();
  const auto elapsed_s = [&] {
    return std::chrono::duration<double>(Clock::now() - begun).count();
  };
  Visualized run(directory, display, GetParam(), {"--duration", "16"});
  const fs::path early = screenshot(std::string(GetParam()) + "-early.png");
  const fs::path late = screenshot(std::string(GetParam()) + "-late.png");
  std::optional<double> early_s;
  wait_until("a picture of the robot", [&] {
    display.picture(run.window(), early);
    early_s = time_in(early, directory);
    return early_s && links_in(early, directory).count > 2000;
  });
  EXPECT_LE(*early_s, elapsed_s());

  // Over, but not shown to its end.
  run.program().wait_for("the window shows the run to its end");
  std::optional<double> late_s;
  wait_until("the robot to move", [&] {
    display.picture(run.window(), late);
    late_s = time_in(late, directory);
    return late_s > *early_s + 0.5 &&
           differing(links_in(early, directory), links_in(late, directory)) > 500;
  });
  // Not a second in less than a second, and 16 s take 16 s, plus what it takes to open and close.
  // (16, so that there is time for two pictures on a machine with other things to do.)
  EXPECT_LE(*late_s, elapsed_s());
  EXPECT_EQ(run.program().wait(), 0) << run.program().errors();
  EXPECT_GT(elapsed_s(), 16);
  EXPECT_LT(elapsed_s(), 45);
  wait_until("the window to close", [&] { return !run.shown(); });
}

INSTANTIATE_TEST_SUITE_P(Robots, ShowsARobot,
                         ::testing::Values("practical_rigid", "iiwa_point_to_point"),
                         [](const auto& robot) { return std::string(robot.param); });

void replace(std::string& text, const std::string& what, const std::string& by) {
  const auto at = text.find(what);
  if (at == std::string::npos) throw std::runtime_error("no " + what);
  text.replace(at, what.size(), by);
}

/// A cube with edges of 1 about the origin, as a text STL and as an OBJ.
void write_cubes(const fs::path& stl, const fs::path& obj) {
  std::ofstream as_stl(stl), as_obj(obj);
  as_stl << "solid cube\n";
  for (int corner = 0; corner < 8; ++corner) {
    as_obj << "v " << (corner & 1) - 0.5 << ' ' << (corner >> 1 & 1) - 0.5 << ' '
           << (corner >> 2) - 0.5 << '\n';
  }
  const int faces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                           {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
  for (const auto& face : faces) {
    as_obj << "f " << face[0] + 1 << ' ' << face[1] + 1 << ' ' << face[2] + 1 << ' ' << face[3] + 1
           << '\n';
    for (int half = 0; half < 2; ++half) {
      as_stl << "facet normal 0 0 0\nouter loop\n";
      for (const int corner : {face[0], face[half + 1], face[half + 2]}) {
        as_stl << "vertex " << (corner & 1) - 0.5 << ' ' << (corner >> 1 & 1) - 0.5 << ' '
               << (corner >> 2) - 0.5 << '\n';
      }
      as_stl << "endloop\nendfacet\n";
    }
  }
  as_stl << "endsolid\n";
}

TEST(Visualize, ShowsTheMeshesOfTheUrdfAndTheToolFrame) {
  const TemporaryDirectory directory;
  const VirtualDisplay display(directory);
  fs::create_directory(directory / "meshes");
  write_cubes(directory / "meshes/cube.stl", directory / "meshes/cube.obj");
  std::string urdf = contents(TACHLESS_SOURCE_DIR "/scenarios/robots/two_link.urdf");
  replace(urdf, R"(<cylinder radius="0.05" length="1"/>)",
          R"(<mesh filename="package://meshes/cube.stl" scale="0.1 0.1 -0.9"/>)");
  replace(urdf, R"(<cylinder radius="0.035" length="1"/>)",
          R"(<mesh filename="meshes/cube.obj" scale="0.1 0.1 0.4"/>)");
  replace(urdf, "0.15 0.35 0.65 1", "1 0 1 1");  // link 1
  replace(urdf, "0.95 0.50 0.10 1", "0 1 1 1");  // link 2
  replace(urdf, R"(<cylinder radius="0.15" length="0.06"/>)", R"(<mesh filename="rotor.dae"/>)");
  std::ofstream(directory / "robot.urdf") << urdf;
  Visualized run(directory, display, "practical_rigid",
                 {"--duration", "100", "--set", "robot.urdf=" + (directory / "robot.urdf").string(),
                  "--set", "plant.initial.position_rad=[0.5, 1.2]"});
  run.program().wait_for("1 of 6 visuals cannot be drawn, cylinders are instead; the first: " +
                         (directory / "robot.urdf").string() +
                         ": link 'rotor': mesh \"rotor.dae\" is not found");
  const fs::path picture = screenshot("meshes.png");
  const auto wait_for_pixels = [&](const std::string& what, int number, IsIt is_it) {
    wait_until(what, [&] {
      display.picture(run.window(), picture);
      return pixels_in(picture, directory, is_it).count > number;
    });
  };
  // Light changes brightness, not the ratios; nothing else in the window has these.
  wait_for_pixels("the STL file, magenta", 1000, [](int red, int green, int blue) {
    return red > 60 && blue > 60 && red > 3 * green && blue > 3 * green;
  });
  wait_for_pixels("the OBJ file, cyan", 1000, [](int red, int green, int blue) {
    return blue > 60 && green > 60 && blue > 3 * red && green > 3 * red;
  });
  wait_for_pixels("the tool's x axis, red", 20, [](int red, int green, int blue) {
    return red > 60 && red > 4 * green && red > 4 * blue;
  });
  wait_for_pixels("the tool's y axis, green", 20, [](int red, int green, int blue) {
    return green > 60 && green > 4 * red && green > 4 * blue;
  });
  wait_for_pixels("the tool's z axis, blue", 20, [](int red, int green, int blue) {
    return blue > 60 && blue > 4 * red && blue > 4 * green;
  });
  run.program().signal(SIGINT);
  EXPECT_THAT(run.program().wait(seconds(20)), AnyOf(0, 130));  // the run may be over or not
}

TEST(Visualize, LeavesTheRunAlone) {
  const TemporaryDirectory directory;
  const VirtualDisplay display(directory);
  std::ofstream(directory / "key") << std::string(32, 'k');
  fs::permissions(directory / "key", fs::perms::owner_read);
  std::vector<std::string> options = {"--run-id",   "7",   "--key-file", directory / "key",
                                      "--duration", "0.5", "--quiet"};
  Program alone("tachless", run_of(directory, "practical_flexible", options), directory.path());
  ASSERT_EQ(alone.wait(), 0) << alone.errors();
  const std::string log = contents(directory / "out/lcmlog");
  // Its window is not waited for: it may have closed before a busy machine finds it.
  options.emplace_back("--visualize");
  Program seen("tachless", run_of(directory, "practical_flexible", options), directory.path());
  // It hears a bus with a key, too: the robot's end is shown.
  EXPECT_EQ(seen.wait(), 0);
  EXPECT_THAT(seen.errors(), IsEmpty());
  EXPECT_TRUE(contents(directory / "out/lcmlog") == log);
}

TEST(Visualize, ClosingTheWindowDoesNotEndTheRun) {
  const TemporaryDirectory directory;
  const VirtualDisplay display(directory);
  Visualized run(directory, display, "practical_rigid", on_the_wall_clock("1000"));
  run.wait_for_the_run();
  output_of("xdotool", {"windowkill", run.window()}, directory);
  run.program().wait_for("the window was closed; the run goes on");
  run.expect_that_it_goes_on();
}

TEST(Visualize, ACrashOfTheWindowsProgramDoesNotEndTheRun) {
  const TemporaryDirectory directory;
  const VirtualDisplay display(directory);
  Visualized run(directory, display, "practical_rigid", on_the_wall_clock("1000"));
  run.wait_for_the_run();
  kill(run.process("tachless-visualizer"), SIGKILL);
  run.program().wait_for("the window is gone: tachless-visualizer was killed by signal 9");
  wait_until("the window to close", [&] { return !run.shown(); });
  run.expect_that_it_goes_on();
}

TEST(Visualize, CtrlCClosesTheWindowOfARunThatIsOver) {
  const TemporaryDirectory directory;
  const VirtualDisplay display(directory);
  Visualized run(directory, display, "practical_rigid", {"--duration", "100"});
  run.program().wait_for("the window shows the run to its end", seconds(120));
  run.program().signal(SIGINT);
  EXPECT_EQ(run.program().wait(seconds(10)), 0);  // the run was done
  wait_until("the window to close", [&] { return !run.shown(); });
}

TEST(Visualize, CtrlCEndsTheRunAndItsWindow) {
  const TemporaryDirectory directory;
  const VirtualDisplay display(directory);
  Visualized run(directory, display, "practical_rigid", on_the_wall_clock("100"));
  run.wait_for_the_run();
  run.program().signal(SIGINT);
  EXPECT_EQ(run.program().wait(seconds(20)), 130);
  wait_until("the window to close", [&] { return !run.shown(); });
}

class VisualizeRefused : public ::testing::Test {
 protected:
  /// What a run with a window says that cannot begin.
  std::string refusal() {
    Program run("tachless", run_of(directory_, "practical_rigid", {"--visualize"}),
                directory_.path());
    EXPECT_EQ(run.wait(), 2);
    EXPECT_FALSE(fs::exists(directory_ / "out")) << "something was started";
    EXPECT_THAT(run.output(), IsEmpty());
    const std::string errors = run.errors();
    EXPECT_EQ(std::count(errors.begin(), errors.end(), '\n'), 1) << errors;
    EXPECT_THAT(errors, AllOf(StartsWith("tachless: --visualize: "),
                              HasSubstr("; or leave out --visualize")));
    return errors;
  }

  TemporaryDirectory directory_;
};

TEST_F(VisualizeRefused, WithoutADisplay) {
  unsetenv("DISPLAY");
  EXPECT_THAT(refusal(), AllOf(HasSubstr("no display: DISPLAY is not set; sit at a desktop"),
                               Not(HasSubstr("watch"))));
  setenv("DISPLAY", ":5000", 1);
  EXPECT_THAT(refusal(), HasSubstr("no X server answers at DISPLAY=:5000"));
}

TEST_F(VisualizeRefused, OnADisplayWithoutOpenGL) {
  const VirtualDisplay display(directory_, {"-extension", "GLX"});
  EXPECT_THAT(refusal(), HasSubstr("apt-get install libgl1-mesa-dri"));
}

TEST(Visualizer, RefusesABadCommandLine) {
  const TemporaryDirectory directory;
  Program program("tachless-visualizer", {"nowhere.yaml"}, directory.path());
  EXPECT_EQ(program.wait(), 2);
  EXPECT_THAT(program.errors(), HasSubstr("nowhere.yaml"));
  Program none("tachless-visualizer", {"--run-id", "0"}, directory.path());
  EXPECT_EQ(none.wait(), 2);
  EXPECT_THAT(none.errors(), HasSubstr("--run-id"));
}

}  // namespace
