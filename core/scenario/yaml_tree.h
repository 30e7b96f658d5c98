#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

/// A YAML document as a plain value that remembers where each part came from. It is stricter than
/// yaml-cpp: a key given twice, a tag, a second document and control characters are errors.
namespace tachless::scenario {

struct YamlNode {
  enum class Kind { null, scalar, list, map };

  Kind kind = Kind::null;
  std::string scalar = {};              ///< text of the scalar as written, without quotes
  bool quoted = false;                  ///< "5" is text, 5 is a number
  std::vector<std::string> keys = {};   ///< keys of a map, in the order written
  std::vector<YamlNode> children = {};  ///< values of a list or a map
  /// "file:line" of the key or the list's entry, or the "--set …" that gave it
  std::string where = {};

  /// Returns the value of `key`; nullptr when this is no map or has no such key.
  [[nodiscard]] const YamlNode* find(std::string_view key) const;
  [[nodiscard]] YamlNode* find(std::string_view key) {
    return const_cast<YamlNode*>(std::as_const(*this).find(key));
  }
  /// Adds a key to a map.
  /// @return its value, which is null
  YamlNode& add(std::string key);
};

/// Reads one document. `source` is the file name for messages. Aliases are expanded.
/// @throw Failure(bad_usage): "source:line: …".
YamlNode parse_yaml(std::string_view text, const std::string& source);

/// Applies "key.path=value" to a map. The value (YAML) replaces whatever is there. Missing keys of
/// the path are created.
/// @throw Failure(bad_usage): "--set key.path=value: …".
void apply_override(YamlNode& root, const std::string& assignment);

/// Returns "key=text" for `apply_override`, in quotes where YAML needs them.
std::string text_override(std::string_view key, const std::string& text);

/// Returns YAML text of the tree: block maps, flow lists, scalars character for character as they
/// were written. Parsing the text gives the same tree again, except for lines.
std::string emit_yaml(const YamlNode& node);

/// Returns the same text on one line, shortened to about 80 characters, for messages.
std::string emit_line(const YamlNode& node);

}  // namespace tachless::scenario
