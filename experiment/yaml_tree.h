#pragma once

#include <string>
#include <string_view>
#include <vector>

/// A YAML document as a plain value that remembers where each part came from. Strict where
/// yaml-cpp is not: a key given twice, a tag, a second document and control characters are errors.
namespace tachless::experiment {

struct YamlNode {
  enum class Kind { null, scalar, list, map };

  Kind kind = Kind::null;
  std::string scalar;              ///< as written, without quotes
  bool quoted = false;             ///< "5" is text, 5 is a number
  std::vector<std::string> keys;   ///< of a map, in the order written
  std::vector<YamlNode> children;  ///< of a list or a map
  int line = 0;                    ///< of the key, or of the entry of a list; 0 when set_by is set
  std::string set_by;              ///< the --set that gave this; empty when it is the file's

  /// The value of `key`; nullptr when this is not a map or has no such key.
  [[nodiscard]] const YamlNode* find(std::string_view key) const;
};

/// Reads one document. `source` is the file name for messages. Aliases are expanded.
/// @throw Failure(bad_usage): "source:line: …".
YamlNode parse_yaml(std::string_view text, const std::string& source);

/// Applies "key.path=value" to a map: the value (YAML) takes the place of what is there, whatever
/// it is; keys on the way are created.
/// @throw Failure(bad_usage): "--set key.path=value: …".
void apply_override(YamlNode& root, const std::string& assignment);

/// YAML text of the tree: block maps, flow lists, scalars character for character as they were
/// written. Parsing it gives the same tree again, but for lines.
std::string emit_yaml(const YamlNode& node);

/// The same on one line, shortened to about 80 characters, for messages.
std::string emit_line(const YamlNode& node);

}  // namespace tachless::experiment
