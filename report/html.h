#pragma once

#include <string>
#include <string_view>

namespace tachless::report {

/// `text` as HTML text or attribute. Bytes that are not UTF-8, and control characters but line end
/// and tab, become the replacement character: texts from a log can be anything.
std::string escaped(std::string_view text);

/// What gnuplot drew, to stand in a page: without what only a file needs, ids and references
/// prefixed (they are the page's, and a page has several), named `caption` for who does not see
/// it.
std::string inline_svg(std::string svg, const std::string& prefix, std::string_view caption);

}  // namespace tachless::report
