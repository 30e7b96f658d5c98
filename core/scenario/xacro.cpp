#include "scenario/xacro.h"

#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
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
  // A file without a name, which xacro gets as its stdin: nothing is left behind by any signal.
  const base::FileDescriptor urdf(memfd_create("robot.urdf", MFD_CLOEXEC));
  if (urdf.get() < 0) throw std::system_error(errno, std::generic_category(), "memfd_create");
  std::vector<std::string> command = {"xacro", fs::absolute(file).string(), "-o", "/dev/stdin"};
  for (const auto& [name, value] : arguments) {
    if (name.empty() || name.front() == '-') {
      throw bad_usage("robot.xacro: \"{}\" is no argument's name; allowed: not - first", name);
    }
    command.push_back(name + ":=" + value);
  }
  base::Child child = base::start(command, base::blocked_signals(), {}, urdf.get());
  const rlimit most{base::max_text_bytes + 1, base::max_text_bytes + 1};
  prlimit(child.pid, RLIMIT_FSIZE, &most, nullptr);
  constexpr std::size_t most_words = 400;
  std::string words;
  const base::End end = base::end_within(child, xacro_patience, [&](const std::string& line) {
    if (words.size() < most_words) words += (words.empty() ? ": " : " ") + line;
  });
  struct stat status {};
  if (!end.well() || fstat(urdf.get(), &status) != 0 || status.st_size == 0) {
    throw bad_usage("{}: xacro {}{}", file.string(), base::text(end),
                    base::printable(words.substr(0, most_words)));
  }
  return base::given_text(fmt::format("/proc/self/fd/{}", urdf.get()), base::max_text_bytes);
}

}  // namespace tachless::scenario
