#include "report/visuals.h"

#include <sodium.h>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <system_error>
#include <utility>
#include <vector>

#include "base/file_text.h"

namespace tachless::report {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t most_bytes = 16'000'000;

/// The values of `filename` in the visuals.
std::vector<std::string> names_in(std::string_view urdf) {
  constexpr std::string_view begin = "<visual", end = "</visual>", key = "filename";
  std::vector<std::string> names;
  for (auto from = urdf.find(begin); from != urdf.npos; from = urdf.find(begin, from + 1)) {
    const std::string_view visual = urdf.substr(from, urdf.find(end, from) - from);
    for (auto at = visual.find(key); at != visual.npos; at = visual.find(key, at + 1)) {
      const auto first = visual.find_first_of("\"'", at);
      if (first == visual.npos) break;
      const auto last = visual.find(visual[first], first + 1);
      names.emplace_back(visual.substr(first + 1, last - first - 1));
    }
  }
  return names;
}

bool drawn(const std::string& name) {
  std::string kind = fs::path(name).extension().string();
  std::ranges::transform(kind, kind.begin(), [](unsigned char c) { return std::tolower(c); });
  return kind == ".stl" || kind == ".obj" || kind == ".dae";
}

fs::path file_of(std::string name, const fs::path& directory) {
  if (name.starts_with("file://")) name.erase(0, 7);
  const auto scheme = name.find("://");
  if (scheme == name.npos) return directory / name;
  const fs::path in_package = name.substr(scheme + 3);
  std::error_code none;
  for (fs::path above = fs::absolute(directory, none);; above = above.parent_path()) {
    if (fs::exists(above / in_package, none)) return above / in_package;
    if (above == above.parent_path()) return {};
  }
}

}  // namespace

std::string base64(std::string_view bytes) {
  constexpr int variant = sodium_base64_VARIANT_ORIGINAL;
  std::string text(sodium_base64_encoded_len(bytes.size(), variant), '\0');
  sodium_bin2base64(text.data(), text.size(), reinterpret_cast<const unsigned char*>(bytes.data()),
                    bytes.size(), variant);
  text.pop_back();  // the NUL that ends it
  return text;
}

Visuals read_visuals(std::string urdf, const fs::path& directory) {
  Visuals result{std::move(urdf), {}};
  std::uintmax_t bytes = 0;
  for (const std::string& name : names_in(result.urdf)) {
    const fs::path file = file_of(name, directory);
    std::error_code none;
    if (!drawn(name) || result.meshes.contains(name) || !fs::is_regular_file(file, none)) continue;
    if (fs::file_size(file, none) > most_bytes - bytes) continue;
    const auto content = base::file_text(file);
    if (!content || content->size() > most_bytes - bytes) continue;
    bytes += content->size();
    result.meshes[name] = base64(*content);
  }
  return result;
}

}  // namespace tachless::report
