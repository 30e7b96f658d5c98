#include "experiment/xacro.h"

#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <vector>

#include "diagnostics/failure.h"
#include "diagnostics/file_text.h"
#include "diagnostics/text.h"
#include "process/child.h"

namespace tachless::experiment {

namespace fs = std::filesystem;
using diagnostics::bad_usage;

std::string urdf_text(const fs::path& file, const std::map<std::string, std::string>& arguments) {
  if (file.extension() != ".xacro") {
    return diagnostics::given_text(file, diagnostics::max_text_bytes);
  }
  if (!process::find_program("xacro")) {
    throw bad_usage(
        "{}: xacro, which makes a URDF of it, is not on the PATH; type: pip install "
        "xacro; or give a URDF",
        file.string());
  }
  const diagnostics::TemporaryDirectory folder;
  const fs::path urdf = folder.path() / "robot.urdf";
  std::vector<std::string> command = {"xacro", fs::absolute(file).string(), "-o", urdf.string()};
  for (const auto& [name, value] : arguments) {
    if (name.empty() || name.front() == '-') {
      throw bad_usage("robot.xacro: \"{}\" is no argument's name; allowed: not - first", name);
    }
    command.push_back(name + ":=" + value);
  }
  process::Child child = process::start(command);
  const rlimit most{diagnostics::max_text_bytes + 1, diagnostics::max_text_bytes + 1};
  prlimit(child.pid, RLIMIT_FSIZE, &most, nullptr);
  constexpr std::size_t most_words = 400;
  std::string words;
  const process::End end = process::end_within(child, xacro_patience, [&](const std::string& line) {
    if (words.size() < most_words) words += (words.empty() ? ": " : " ") + line;
  });
  if (!end.well() || !fs::exists(urdf)) {
    throw bad_usage("{}: xacro {}{}", file.string(), process::text(end),
                    diagnostics::printable(words.substr(0, most_words)));
  }
  return diagnostics::given_text(urdf, diagnostics::max_text_bytes);
}

}  // namespace tachless::experiment
