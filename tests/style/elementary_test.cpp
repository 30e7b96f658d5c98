// Functions of <cmath> that IEEE 754 does not fix give bits that depend on the processor. Code
// whose results go round the loop or into a log uses base/elementary.h instead.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

/// Returns "file:line: text" of each call in `text` that base/elementary.h replaces.
std::vector<std::string> calls_of_libm(std::istream& text, const std::string& file) {
  const std::string names =
      "(sin|cos|tan|asin|acos|atan|atan2|sinh|cosh|tanh|asinh|acosh|atanh|exp|exp2|expm1|log|log2|"
      "log10|log1p|pow|cbrt|hypot|fma|erf|erfc|tgamma|lgamma)";
  // The pattern matches a call of the standard library with or without its namespace, a method of
  // an Eigen array, and an Eigen rotation by an angle.
  const std::regex forbidden("(^|[^:\\w.>\"])(std::|::)?" + names + "\\(|std::" + names +
                             "\\b|\\)\\." + names + "\\(\\)|AngleAxis|setFromRPY");
  std::vector<std::string> found;
  std::string line;
  for (int number = 1; std::getline(text, line); ++number) {
    std::string code = std::regex_replace(line, std::regex("//.*|\"[^\"]*\""), "");
    code = std::regex_replace(code, std::regex("base::\\w+"), "");
    if (std::regex_search(code, forbidden)) {
      found.push_back(file + ":" + std::to_string(number) + ": " + line);
    }
  }
  return found;
}

TEST(Elementary, CodeThatGoesRoundTheLoopCallsNoFunctionOfTheCLibrary) {
  std::vector<std::string> found;
  std::size_t files = 0;
  for (const char* folder :
       {"core", "plant", "reference", "controller", "logger", "analysis/in_process"}) {
    for (const auto& entry :
         fs::recursive_directory_iterator(fs::path(TACHLESS_SOURCE_DIR) / folder)) {
      const fs::path& path = entry.path();
      if (path.extension() != ".h" && path.extension() != ".cpp") continue;
      if (path.stem() == "elementary") continue;
      ++files;
      std::ifstream text(path);
      const std::string file = path.lexically_relative(TACHLESS_SOURCE_DIR).string();
      for (const std::string& call : calls_of_libm(text, file)) found.push_back(call);
    }
  }
  EXPECT_GT(files, 100U);
  EXPECT_THAT(found, ::testing::IsEmpty());
}

TEST(Elementary, TheRuleSeesEachWayToCall) {
  for (const char* code :
       {"x = std::sin(y);", "x = exp(y);", "x = ::pow(y, 2);", "v.array().tanh()",
        "v.unaryExpr(&std::tanh)", "Eigen::AngleAxisd(a, axis)", "r.setFromRPY(a, b, c);"}) {
    std::istringstream text(code);
    EXPECT_EQ(calls_of_libm(text, "f").size(), 1U) << code;
  }
  for (const char* code : {"base::sin(y)", "// std::sin(y)", "\"a sin(2 t)\"",
                           "base::log_detail(x)", "std::sqrt(x)", "x.log(y)"}) {
    std::istringstream text(code);
    EXPECT_EQ(calls_of_libm(text, "f").size(), 0U) << code;
  }
}

}  // namespace
