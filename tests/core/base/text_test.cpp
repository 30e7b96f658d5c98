#include "base/text.h"

#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <string>
#include <vector>

namespace tachless::base {
namespace {

TEST(Text, JoinsWhateverFmtCanWrite) {
  EXPECT_EQ(joined(std::vector<std::string>{"link", "motor"}), "link, motor");
  EXPECT_EQ(joined(std::array{1.5, 2.0}, "; "), "1.5; 2");
  EXPECT_EQ(joined(std::vector<int>{}), "");
}

TEST(Text, ShortestNumberGivesTheValueBack) {
  EXPECT_EQ(shortest(0.1), "0.1");
  EXPECT_EQ(shortest(1.0 / 3), "0.3333333333333333");
  EXPECT_EQ(shortest(5e-5), "5e-05");
  EXPECT_EQ(shortest(-std::numeric_limits<double>::max()), "-1.7976931348623157e+308");
  EXPECT_EQ(shortest(std::numeric_limits<double>::quiet_NaN()), "nan");
  const double awkward = 0.1 + 0.2;
  EXPECT_EQ(std::stod(shortest(awkward)), awkward);
}

TEST(Text, PeriodsHaveTheUnitPeopleUse) {
  EXPECT_EQ(period_text(5e-5), "50 µs");
  EXPECT_EQ(period_text(1.25e-4), "125 µs");
  EXPECT_EQ(period_text(0.999999e-3), "1 ms");
  EXPECT_EQ(period_text(0.02), "20 ms");
  EXPECT_EQ(period_text(1.5), "1.5 s");
}

TEST(Text, OneLineHasNoControlCharactersAndKeepsOrdinarySpaces) {
  EXPECT_EQ(one_line("a  file.yaml: bad\n\n   value\r\n"), "a  file.yaml: bad value");
  EXPECT_EQ(one_line("\t a\x1B[2Jb\x7F "), "a [2Jb");
  EXPECT_EQ(one_line("5 × \n"), "5 ×");
  EXPECT_EQ(one_line(" \n"), "");
}

TEST(Text, NearestIsTheNameThatWasProbablyMeant) {
  const std::vector<std::string> laws = {"pd_rigid", "loria_ortega_rigid", "loria_ortega_flexible"};
  EXPECT_EQ(nearest("loria", laws), "loria_ortega_rigid");
  EXPECT_EQ(nearest("loria_ortega_flexibel", laws), "loria_ortega_flexible");
  EXPECT_EQ(nearest("PD_rigid", laws), "pd_rigid");
  const std::array keys = {"controller.gains.kp", "loop.period_s", "reference.hold.position_rad"};
  EXPECT_EQ(nearest("kp", keys), "controller.gains.kp");
  EXPECT_EQ(nearest("gains.kp", keys), "controller.gains.kp");
  EXPECT_EQ(nearest("loop.perod_s", keys), "loop.period_s");
  EXPECT_EQ(nearest("reference.hold.position", keys), "reference.hold.position_rad");
}

TEST(Text, NearestPrefersTheWholeNameToABeginningAndABeginningToAMisspelling) {
  EXPECT_EQ(nearest("hold", std::array{"hold_position", "hold"}), "hold");
  EXPECT_EQ(nearest("hold", std::array{"bold", "hold_position"}), "hold_position");
}

TEST(Text, NearestIsNothingWhenNoNameIsSimilar) {
  const std::array gains = {"kp", "kd"};
  EXPECT_EQ(nearest("kq", gains), "kp");  // one of two characters
  EXPECT_EQ(nearest("xy", gains), std::nullopt);
  EXPECT_EQ(nearest("k", std::array{"controller.gains.k2"}), std::nullopt);
  EXPECT_EQ(nearest("p", std::array{"robot.name.pp"}), std::nullopt);
  EXPECT_EQ(nearest("od_s", std::array{"loop.period_s"}), std::nullopt) << "not a whole part";
  EXPECT_EQ(nearest("sliding_mode", std::array{"pd_rigid", "loria_ortega_rigid"}), std::nullopt);
  EXPECT_EQ(nearest("kp", std::vector<std::string>{}), std::nullopt);
}

TEST(Text, ShellWordIsReadAsItselfByAShell) {
  EXPECT_EQ(shell_word("out/arm-1.yaml"), "out/arm-1.yaml");
  EXPECT_EQ(shell_word("my arm"), "'my arm'");
  EXPECT_EQ(shell_word("it's"), "'it'\\''s'");
  EXPECT_EQ(shell_word("$(halt)"), "'$(halt)'");
  EXPECT_EQ(shell_word("-arm.yaml"), "./-arm.yaml");
  EXPECT_EQ(shell_word("- arm"), "'./- arm'");
  EXPECT_EQ(shell_word(""), "''");
}

TEST(Text, CsvFieldIsQuotedOnlyWhereItHasToBe) {
  EXPECT_EQ(csv_field("q_elbow_rad"), "q_elbow_rad");
  EXPECT_EQ(csv_field(""), "");
  EXPECT_EQ(csv_field("a,b"), "\"a,b\"");
  EXPECT_EQ(csv_field("a #b"), "\"a #b\"");
  EXPECT_EQ(csv_field("say \"a\"\n"), "\"say \"\"a\"\"\n\"");
}

TEST(Text, CsvFieldIsNoFormula) {
  EXPECT_EQ(csv_field("=HYPERLINK(1)"), "'=HYPERLINK(1)");
  EXPECT_EQ(csv_field("+a,b"), "\"'+a,b\"");
  EXPECT_EQ(csv_field("@a"), "'@a");
  EXPECT_EQ(csv_field("-a"), "'-a");
  for (const char* number : {"-1", "-0.5e-3", "-inf"}) EXPECT_EQ(csv_field(number), number);
}

TEST(Text, PrintableKeepsUtf8AndReplacesTheRest) {
  EXPECT_EQ(printable("plain"), "plain");
  EXPECT_EQ(printable("\xe2\x82\xac"), "\xe2\x82\xac");
  EXPECT_EQ(printable("a\nb\x7f"), "a?b?");
  EXPECT_EQ(printable("a\xe2\x80\xae"
                      "b\xe2\x81\xa6"
                      "c\xe2\x80\x90"),
            "a?b?c\xe2\x80\x90");
  EXPECT_EQ(printable("\xc2\x9b"
                      "31m \xc2\xb5s"),
            "?31m \xc2\xb5s")
      << "CSI in one character";
  EXPECT_EQ(printable("\xc0\x80\xed\xa0\x80\xf5\xe2\x82"), "????????");
}

}  // namespace
}  // namespace tachless::base
