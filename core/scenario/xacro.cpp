#include "scenario/xacro.h"

#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <algorithm>
#include <map>
#include <regex>
#include <sstream>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "base/child.h"
#include "base/failure.h"
#include "base/file_descriptor.h"
#include "base/file_text.h"
#include "base/text.h"

namespace tachless::scenario {

namespace fs = std::filesystem;
using base::bad_usage;

namespace {

using Arguments = std::map<std::string, std::string>;

/// Runs xacro with `options`. @return its output
/// @throw Failure(bad_usage) with the first words of xacro's error
std::string run_xacro(const fs::path& file, const Arguments& arguments,
                      const std::vector<std::string>& options) {
  // The output is a file without a name, which xacro gets as its stdin: no signal leaves it behind.
  const base::FileDescriptor output(memfd_create("xacro", MFD_CLOEXEC));
  if (output.get() < 0) throw std::system_error(errno, std::generic_category(), "memfd_create");
  std::vector<std::string> command = {"xacro", fs::absolute(file).string(), "-o", "/dev/stdin"};
  command.insert(command.end(), options.begin(), options.end());
  for (const auto& [name, value] : arguments) {
    if (name.empty() || name.front() == '-') {
      throw bad_usage("robot.xacro: \"{}\" is no argument's name; allowed: not - first", name);
    }
    command.push_back(name + ":=" + value);
  }
  base::StartOptions start;
  start.input = output.get();
  base::Child child = base::start(command, start);
  const rlimit most{base::max_text_bytes + 1, base::max_text_bytes + 1};
  prlimit(child.pid, RLIMIT_FSIZE, &most, nullptr);
  constexpr std::size_t most_words = 400;
  std::string words;
  const base::End end = base::end_within(child, xacro_patience, [&](const std::string& line) {
    if (words.size() < most_words) words += (words.empty() ? ": " : " ") + line;
  });
  // xacro may end with 0 without a URDF; a list of included files may be empty.
  struct stat status {};
  if (end.well() && fstat(output.get(), &status) == 0 && (status.st_size > 0 || !options.empty())) {
    return base::given_text(fmt::format("/proc/self/fd/{}", output.get()), base::max_text_bytes);
  }
  constexpr std::string_view undefined = "Undefined substitution argument ";
  std::string remedy;
  if (const std::size_t at = words.find(undefined); at != std::string::npos) {
    const std::string name = words.substr(at + undefined.size());
    remedy = fmt::format("; give robot.xacro: {{{0}: …}}, or --set robot.xacro.{0}=…",
                         base::printable(name.substr(0, name.find(' '))));
  }
  throw bad_usage("{}: xacro {}{}{}", file.string(), base::text(end),
                  base::printable(words.substr(0, most_words)), remedy);
}

/// Appends the names of the arguments that a file declares.
void add_declared(const std::string& text, std::vector<std::string>& names) {
  static const std::regex declared(R"(<[A-Za-z_]+:arg\s[^>]*?name\s*=\s*["']([^"']*)["'])");
  for (std::sregex_iterator at(text.begin(), text.end(), declared), end; at != end; ++at) {
    names.push_back((*at)[1]);
  }
}

/// Refuses an argument that neither the file nor a file that it includes declares: xacro passes it
/// over.
void require_declared(const fs::path& file, const Arguments& arguments) {
  std::vector<std::string> names;
  add_declared(base::given_text(file, base::max_text_bytes), names);
  const auto unknown = [&] {
    return std::ranges::find_if(arguments, [&](const auto& argument) {
      return std::ranges::find(names, argument.first) == names.end();
    });
  };
  if (unknown() == arguments.end()) return;
  std::istringstream included(run_xacro(file, arguments, {"--deps"}));
  for (std::string each; included >> each;) {
    if (fs::is_regular_file(each)) {
      add_declared(base::given_text(each, base::max_text_bytes), names);
    }
  }
  const auto found = unknown();
  if (found == arguments.end()) return;
  const auto near = base::nearest(found->first, names);
  throw bad_usage("{}: robot.xacro: it has no <xacro:arg> \"{}\"; {}", file.string(), found->first,
                  near ? "the nearest is " + *near : "it has " + base::joined(names));
}

}  // namespace

std::string urdf_text(const fs::path& file, const std::map<std::string, std::string>& arguments) {
  if (file.extension() != ".xacro") {
    return base::given_text(file, base::max_text_bytes);
  }
  if (!base::find_program("xacro")) {
    throw bad_usage(
        "{}: xacro, which makes a URDF of it, is not on the PATH; type: pip install "
        "xacro; or give a URDF",
        file.string());
  }
  std::string text = run_xacro(file, arguments, {});
  require_declared(file, arguments);
  return text;
}

}  // namespace tachless::scenario
