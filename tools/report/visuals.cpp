#include "report/visuals.h"

#include <fcntl.h>
#include <sodium.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "base/file_descriptor.h"

namespace tachless::report {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t most_bytes = 16'000'000;
constexpr std::size_t most_faces = 500'000;

/// Returns the values of `filename` in the visuals.
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

/// Returns the extension of a mesh that the page can draw, for example ".stl", or "".
std::string kind_of(const std::string& name) {
  std::string kind = fs::path(name).extension().string();
  std::ranges::transform(kind, kind.begin(), [](unsigned char c) { return std::tolower(c); });
  return kind == ".stl" || kind == ".obj" || kind == ".dae" ? kind : "";
}

/// A mesh, and the folder in which it has to be after all links are followed.
struct Place {
  fs::path file, root;
};

Place place_of(std::string name, const fs::path& directory) {
  if (name.starts_with("file://")) name.erase(0, 7);
  const auto scheme = name.find("://");
  if (scheme == name.npos) {
    const fs::path normal = fs::path(name).lexically_normal();
    if (normal.is_absolute()) return {normal, normal.parent_path()};
    fs::path root = directory;
    for (auto part = normal.begin(); part != normal.end() && *part == ".."; ++part) root /= "..";
    return {directory / normal, root};
  }
  const fs::path in_package = fs::path(name.substr(scheme + 3)).lexically_normal();
  std::error_code none;
  for (fs::path above = fs::absolute(directory, none);; above = above.parent_path()) {
    if (fs::exists(above / in_package, none)) {
      return {above / in_package, above / *in_package.begin()};
    }
    if (above == above.parent_path()) return {};
  }
}

/// Returns the content of a regular file in its folder, or nullopt if it has more than `most`
/// bytes. A link that leads out of the folder is not followed.
std::optional<std::string> mesh_bytes(const Place& place, std::uintmax_t most) {
  std::error_code error;
  const fs::path file = fs::canonical(place.file, error);
  if (error) return std::nullopt;
  const fs::path root = fs::canonical(place.root, error);
  if (error || std::ranges::mismatch(root, file).in1 != root.end()) return std::nullopt;
  // One descriptor serves all checks, because the name may refer to another file later.
  const base::FileDescriptor opened(
      ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  struct stat status {};
  if (opened.get() < 0 || fstat(opened.get(), &status) != 0 || !S_ISREG(status.st_mode) ||
      static_cast<std::uintmax_t>(status.st_size) > most) {
    return std::nullopt;
  }
  std::string bytes(static_cast<std::size_t>(status.st_size), '\0');
  std::size_t size = 0;
  while (size < bytes.size()) {
    const ssize_t got = ::read(opened.get(), bytes.data() + size, bytes.size() - size);
    if (got <= 0) break;
    size += static_cast<std::size_t>(got);
  }
  bytes.resize(size);
  return bytes;
}

std::size_t count_of(std::string_view word, std::string_view text) {
  std::size_t count = 0;
  for (auto at = text.find(word); at != text.npos; at = text.find(word, at + word.size())) ++count;
  return count;
}

std::size_t num_blanks(std::string_view text) {
  return static_cast<std::size_t>(
      std::ranges::count_if(text, [](char c) { return c == ' ' || c == '\t' || c == '\n'; }));
}

/// Returns the number of triangles of an OBJ, or more. Each line that is no vertex counts: it may
/// continue the polygon of the line before.
std::size_t num_faces_of_obj(std::string_view bytes) {
  std::size_t faces = 0;
  while (!bytes.empty()) {
    const std::string_view line = bytes.substr(0, bytes.find('\n'));
    if (!line.starts_with('v') && !line.starts_with('#')) {
      faces += std::max<std::size_t>(num_blanks(line), 3) - 2;
    }
    bytes.remove_prefix(std::min(bytes.size(), line.size() + 1));
  }
  return faces;
}

/// Returns an upper bound on the number of triangles of a mesh. For a DAE it is a third of the
/// numbers in <p>.
std::size_t num_faces(const std::string& kind, std::string_view bytes) {
  if (kind == ".obj") return num_faces_of_obj(bytes);
  if (kind == ".stl") return std::max(count_of("facet normal", bytes), bytes.size() / 50);
  constexpr std::string_view after_name = "> \t\r\n";
  std::size_t numbers = 0;
  for (auto at = bytes.find("<p"); at != bytes.npos; at = bytes.find("<p", at)) {
    at += 2;
    if (after_name.find(bytes.substr(at, 1)) == after_name.npos) continue;
    const std::string_view list = bytes.substr(at, bytes.find("</p", at) - at);
    numbers += num_blanks(list) + 1;
    at += list.size();
  }
  return numbers / 3;
}

}  // namespace

std::string base64(std::string_view bytes) {
  constexpr int variant = sodium_base64_VARIANT_ORIGINAL;
  std::string text(sodium_base64_encoded_len(bytes.size(), variant), '\0');
  sodium_bin2base64(text.data(), text.size(), reinterpret_cast<const unsigned char*>(bytes.data()),
                    bytes.size(), variant);
  text.pop_back();  // removes the terminating NUL
  return text;
}

Visuals read_visuals(std::string urdf, const fs::path& directory) {
  Visuals result{std::move(urdf), {}};
  std::uintmax_t bytes = 0;
  std::size_t faces = 0;
  for (const std::string& name : names_in(result.urdf)) {
    const std::string kind = kind_of(name);
    if (kind.empty() || result.meshes.contains(name)) continue;
    const auto content = mesh_bytes(place_of(name, directory), most_bytes - bytes);
    if (!content) continue;
    const std::size_t own_faces = num_faces(kind, *content);
    if (own_faces > most_faces - faces) continue;
    bytes += content->size();
    faces += own_faces;
    result.meshes[name] = base64(*content);
  }
  return result;
}

}  // namespace tachless::report
