#include "report/gnuplot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "diagnostics/failure.h"
#include "tests/support/temporary_directory.h"

namespace tachless::report {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;

std::string refusal(const std::string& commands, const std::filesystem::path& svg) {
  try {
    draw(commands, svg);
  } catch (const diagnostics::Failure& failure) {
    EXPECT_EQ(failure.code(), diagnostics::ExitCode::bad_usage);
    EXPECT_FALSE(std::filesystem::exists(svg.string() + ".gnuplot")) << "the commands are left";
    return failure.what();
  }
  return "none";
}

TEST(Gnuplot, RefusalGivesItsReasonAndNotTheCommand) {
  const TemporaryDirectory directory;
  const auto svg = directory.path() / "a.svg";
  EXPECT_EQ(refusal("plot nonsense_(\n", svg),
            "gnuplot did not draw " + svg.string() + ": invalid expression");
  EXPECT_THAT(refusal("set terminal svg\nset output '/nowhere/a.svg'\nplot 1\n", svg),
              EndsWith(": cannot open file; output not changed"));
}

TEST(Gnuplot, ComplaintIsTheLineWithThePlaceElseTheLast) {
  EXPECT_EQ(gnuplot_complaint({"", "plot $a", "     ^", "\"c.gp\" line 1: no datablock named $a",
                               "system error: 2", ""}),
            "no datablock named $a");
  EXPECT_EQ(gnuplot_complaint({"", "out of memory", " "}), "out of memory");
  EXPECT_EQ(gnuplot_complaint({"", ""}), "it gave no reason");
}

TEST(Gnuplot, MissingIsNamedWithWhatToType) {
  const TemporaryDirectory directory;
  const std::string path = std::getenv("PATH");
  setenv("PATH", directory.path().c_str(), 1);
  const std::string why = refusal("plot 1\n", directory.path() / "a.svg");
  setenv("PATH", path.c_str(), 1);
  EXPECT_THAT(why, HasSubstr("apt-get install gnuplot-nox"));
}

TEST(Gnuplot, LiteralsAreExactlyTheirText) {
  EXPECT_EQ(gnuplot_string("it's"), "'it''s'");
  EXPECT_EQ(gnuplot_text("a_b^{2}\n@&~\\"), "'a\\_b\\^\\{2\\} \\@\\&\\~\\\\'");
}

}  // namespace
}  // namespace tachless::report
