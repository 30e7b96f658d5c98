// The scenarios of docs/examples.md: they run as documented, with the gains that design finds.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <regex>

#include "base/json_text.h"
#include "tests/support/program.h"
#include "tests/support/temporary_directory.h"

namespace tachless::gallery_test {
namespace {

const std::string root = TACHLESS_SOURCE_DIR;

struct Row {
  std::string scenario, law, period, joints, error;
};

std::vector<Row> rows() {
  const std::string page = contents(root + "/docs/examples.md");
  const std::regex row(
      R"(\| \[(\w+)\]\(\.\./scenarios/\w+\.yaml\) \| [^|]* \| `(\w+)` \| ([^|]*) \| (\d+) \| (\S+) \|)");
  std::vector<Row> result;
  for (std::sregex_iterator at(page.begin(), page.end(), row), end; at != end; ++at) {
    result.push_back({(*at)[1], (*at)[2], (*at)[3], (*at)[4], (*at)[5]});
  }
  return result;
}

std::string output_of_tachless(const std::string& arguments, const TemporaryDirectory& directory) {
  Program program(
      "bash", {"-c", "cd " + root + " && exec " TACHLESS_BINARY_DIR "/bin/tachless " + arguments},
      directory.path());
  if (program.wait() != 0) throw std::runtime_error(arguments + ": " + program.errors());
  return program.output();
}

TEST(TheGallery, RunsAsItsPageSays) {
  ASSERT_EQ(rows().size(), 4U);
  for (const Row& row : rows()) {
    const TemporaryDirectory directory;
    output_of_tachless("run scenarios/" + row.scenario + ".yaml --in-process --quiet --out " +
                           directory.path().string(),
                       directory);
    const auto summary = base::parse_json(contents(directory / "summary.json"));
    EXPECT_EQ(summary["law"], row.law) << row.scenario;
    EXPECT_EQ(std::to_string(summary["joints"].size()), row.joints) << row.scenario;
    EXPECT_EQ(fmt::format("{} µs", 1e6 * summary["period_s"].get<double>()),
              row.period == "1 ms" ? "1000 µs" : row.period)
        << row.scenario;
    const auto& peaks = summary["position_error_rad"]["peak"];
    EXPECT_EQ(fmt::format("{:.2e}", std::ranges::max_element(peaks)->get<double>()), row.error)
        << row.scenario;
    EXPECT_THAT(contents(root + "/docs/examples.md"),
                testing::HasSubstr("](figures/gallery_" + row.scenario + ".png)"));
  }
}

}  // namespace
}  // namespace tachless::gallery_test
