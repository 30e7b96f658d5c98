#include "report/html.h"

#include <gtest/gtest.h>

namespace tachless::report {
namespace {

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

TEST(Html, MakesAFilesDrawingAPartOfAPage) {
  const std::string svg = inline_svg(
      "<?xml version=\"1.0\"?>\n<svg \n viewBox=\"0 0 5 3\"\n xmlns=\"http://www.w3.org/2000/svg\">"
      "<title>Gnuplot</title><desc>x</desc><defs><circle id='gpDot'/></defs>"
      "<use xlink:href='#gpDot'/><g clip-path=\"url(#a)\" id=\"g\"></g></svg>",
      "p-", "a \"curve\"");
  EXPECT_EQ(svg,
            "<svg role=\"img\" aria-label=\"a &quot;curve&quot;\" \n viewBox=\"0 0 5 3\"\n>"
            "<defs><circle id='p-gpDot'/></defs><use xlink:href='#p-gpDot'/>"
            "<g clip-path=\"url(#p-a)\" id=\"p-g\"></g></svg>");
}

}  // namespace
}  // namespace tachless::report
