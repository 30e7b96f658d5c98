// Every law must have one header, one page in docs/laws and one test. The page must contain the
// law's declarations.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "controller/registry.h"

namespace tachless::controller {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::UnorderedElementsAreArray;

const fs::path root = TACHLESS_SOURCE_DIR;

std::string text_of(const fs::path& path) {
  std::ifstream file(path);
  EXPECT_TRUE(file) << path;
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

std::vector<std::string> stems(const fs::path& folder, const std::string& holding) {
  std::vector<std::string> found;
  for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
    if (!entry.is_regular_file()) continue;
    if (text_of(entry.path()).find(holding) != std::string::npos) {
      found.push_back(entry.path().stem());
    }
  }
  return found;
}

/// Returns the law's header: beside law.h, or among the rivals.
fs::path header_of(std::string_view law) {
  const fs::path own = root / "controller/law", name = std::string(law) + ".h";
  return fs::exists(own / name) ? own / name : own / "rivals" / name;
}

std::string quoted(std::string_view word) { return "`" + std::string(word) + "`"; }

TEST(LawPages, AreOnePerLawAsAreHeadersAndLinesOfTheList) {
  EXPECT_THAT(stems("controller/law", "static constexpr std::string_view name ="),
              UnorderedElementsAreArray(law_names()));
  EXPECT_THAT(stems("docs/laws", "# "), UnorderedElementsAreArray(law_names()));
  for (const std::string_view law : law_names()) {
    EXPECT_TRUE(fs::exists(root / "tests/controller/law" / (std::string(law) + "_test.cpp")))
        << law;
  }
}

TEST(LawPages, SayWhatTheLawDeclares) {
  for (const LawFacts& law : laws()) {
    const std::string page = text_of(root / "docs/laws" / (std::string(law.name) + ".md"));
    EXPECT_THAT(page, AllOf(HasSubstr("# " + std::string(law.name)),
                            HasSubstr(quoted(law.measurement)), HasSubstr("**Source.**"),
                            HasSubstr("| what is proved | " + std::string(law.proved)),
                            HasSubstr("| conditions |"), HasSubstr("| sampled limit |")));
    for (const Parameter& parameter : law.parameters) {
      EXPECT_THAT(page, HasSubstr(quoted(parameter.name)));
      EXPECT_THAT(page, HasSubstr("[" + std::string(parameter.unit) + "]"));
    }
    for (const messages::Signal& signal : law.signals)
      EXPECT_THAT(page, HasSubstr(quoted(signal.name)));
  }
}

TEST(LawPages, HeadersEndWithTheLockThatTheirMeasurementAsksFor) {
  const std::map<std::string_view, std::string> locks = {
      {"POSITION", "static_assert(OutputFeedbackLaw<"},
      {"MOTOR_POSITION", "static_assert(OutputFeedbackLaw<"},
      {"BOTH_POSITIONS", "static_assert(OutputFeedbackLaw<"},
      {"LINK_STATE", "::Measurement, messages::LinkStateMeasurement>);"},
      {"STATE", "static_assert(!OutputFeedbackLaw<"}};
  for (const LawFacts& law : laws()) {
    const std::string header = text_of(header_of(law.name));
    EXPECT_GT(header.rfind(locks.at(law.measurement)), header.rfind("};")) << law.name;
    EXPECT_NE(header.rfind(locks.at(law.measurement)), std::string::npos) << law.name;
  }
}

}  // namespace
}  // namespace tachless::controller
