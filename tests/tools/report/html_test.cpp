#include "report/html.h"

#include <gtest/gtest.h>

#include <type_traits>

namespace tachless::report {
namespace {

std::string escaped(std::string_view text) { return Html(text).markup(); }

TEST(Html, EscapesWhatHasAMeaning) {
  EXPECT_EQ(escaped("<b title=\"x\">'&'</b>"),
            "&lt;b title=&quot;x&quot;&gt;&#39;&amp;&#39;&lt;/b&gt;");
  EXPECT_EQ(escaped("é ν ½ 🙂\n\t"), "é ν ½ 🙂\n\t");
}

TEST(Html, ReplacesWhatIsNoText) {
  for (const std::string bad :
       {"\xFF", "\xC0", "\xE2\x82", "\xED\xA0\x80", "\xF5", "\x01", "\x80"}) {
    const std::string text = escaped("a" + bad + "b");
    EXPECT_EQ(text.find(bad), std::string::npos);
    EXPECT_TRUE(text.starts_with("a\uFFFD") && text.ends_with("b")) << text;
  }
  EXPECT_EQ(escaped(std::string("a\0b", 3)), "a\uFFFDb");
}

TEST(Html, PatternIsMarkupAndTextIsEscaped) {
  const Html bold = html("<b>{}</b>", "a < b");
  EXPECT_EQ(bold.markup(), "<b>a &lt; b</b>");
  EXPECT_EQ(html("<p>{} {} {}</p>", bold, std::string("<p"), 7).markup(),
            "<p><b>a &lt; b</b> &lt;p 7</p>");
  static_assert(!std::is_convertible_v<std::string, Html>, "text becomes HTML visibly");
  EXPECT_EQ(joined({Html("<"), bold}, html("<br>")).markup(), "&lt;<br><b>a &lt; b</b>");
}

TEST(Html, NumbersHaveMinusSignsAndPowersOfTen) {
  EXPECT_EQ(number("-1.50e-05").markup(), "−1.50·10<sup>−5</sup>");
  EXPECT_EQ(number("2.00e+00").markup(), "2.00");
  EXPECT_EQ(number("3e+12").markup(), "3·10<sup>12</sup>");
  EXPECT_EQ(number("-4").markup(), "−4");
}

}  // namespace
}  // namespace tachless::report
