#include "report/plain_page.h"

#include "diagnostics/file_text.h"
#include "diagnostics/unfinished_file.h"
#include "diagnostics/version.h"
#include "report/gnuplot.h"
#include "report/page_files.h"

namespace tachless::report {

void write_plain_page(const std::filesystem::path& path, const std::string& title, const Html& body,
                      const std::string& scenario) {
  const Html page = html(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<link rel=\"icon\" href=\"data:,\">\n<title>{0}</title>\n<style>\n{1}</style>\n</head>\n"
      "<body>\n<main>\n<h1>{0}</h1>\n{2}<details><summary>Scenario</summary><pre>{3}</pre>"
      "</details>\n<footer>Written by tachless {4}.</footer>\n</main>\n</body>\n</html>\n",
      title, Html::from_markup(page_css), body, scenario, diagnostics::version);
  diagnostics::UnfinishedFile(path, "name another directory with --out").write(page.markup());
}

Html drawn_figure(const std::filesystem::path& svg,
                  const std::function<std::string(const std::filesystem::path&)>& commands,
                  const std::string& caption) {
  diagnostics::UnfinishedFile unfinished(svg, "name another directory with --out");
  draw(commands(unfinished.name()), unfinished.name());
  unfinished.finish();
  const std::string picture = diagnostics::file_text(svg).value_or("");
  return html("<figure>{}</figure>\n", inline_svg(picture, "figure-", caption));
}

}  // namespace tachless::report
