#include "experiment/yaml_tree.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <stdexcept>

#include "diagnostics/failure.h"

namespace tachless::experiment {
namespace {

// Aliases can make a short text unfold into a huge tree, or into an endless one.
constexpr int max_nodes = 20'000;
constexpr int max_depth = 32;

class Converter {
 public:
  /// @param source of a file its name; else the "--set key=value" that stands in for "file:line"
  Converter(const std::string& source, bool of_file) : source_(source), of_file_(of_file) {}

  YamlNode convert(const YAML::Node& from, int line, const std::string& path, int depth) {
    if (++num_nodes_ > max_nodes || depth > max_depth) {
      throw complaint(
          line, path,
          "too large or nested too deeply; allowed: {} values, {} levels, aliases included",
          max_nodes, max_depth);
    }
    YamlNode to;
    to.where = where(line);
    const std::string& tag = from.Tag();
    if (!tag.empty() && tag != "?" && tag != "!") {
      throw complaint(line, path, "tag '{}' is not known; write the value without a tag", tag);
    }
    if (from.IsScalar()) {
      to.kind = YamlNode::Kind::scalar;
      to.scalar = from.Scalar();
      to.quoted = tag == "!";
    } else if (from.IsSequence()) {
      to.kind = YamlNode::Kind::list;
      for (const YAML::Node& item : from) {
        to.children.push_back(convert(item, std::max(line, item.Mark().line + 1),
                                      fmt::format("{}[{}]", path, to.children.size()), depth + 1));
      }
    } else if (from.IsMap()) {
      to.kind = YamlNode::Kind::map;
      for (const auto& pair : from) add_pair(pair.first, pair.second, path, depth, to);
    }
    return to;
  }

  template <class... Args>
  [[nodiscard]] diagnostics::Failure complaint(int line, const std::string& path,
                                               fmt::format_string<Args...> problem,
                                               Args&&... args) const {
    return diagnostics::bad_usage("{}: {}{}{}", where(line), path, path.empty() ? "" : ": ",
                                  fmt::format(problem, std::forward<Args>(args)...));
  }

 private:
  [[nodiscard]] std::string where(int line) const {
    return of_file_ ? fmt::format("{}:{}", source_, line) : source_;
  }

  void add_pair(const YAML::Node& key, const YAML::Node& value, const std::string& path, int depth,
                YamlNode& to) {
    const int line = key.Mark().line + 1;
    if (!key.IsScalar() || key.Scalar().empty()) {
      throw complaint(line, path, "a key must be a word");
    }
    const std::string key_path = path.empty() ? key.Scalar() : path + "." + key.Scalar();
    if (const YamlNode* first = to.find(key.Scalar())) {
      if (!of_file_) throw complaint(line, key_path, "given twice");
      throw complaint(line, key_path, "given twice; first in line {}",
                      first->where.substr(source_.size() + 1));
    }
    to.add(key.Scalar()) = convert(value, line, key_path, depth + 1);
  }

  const std::string& source_;
  const bool of_file_;
  int num_nodes_ = 0;
};

YamlNode parse(std::string_view text, const std::string& source, bool of_file,
               const std::string& path) {
  Converter converter(source, of_file);
  // yaml-cpp takes byte 4 for the end of the text, and a NUL would not survive a message.
  const auto control = std::find_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\r' && c != '\t') ||
           c == 0x7f;
  });
  if (control != text.end()) {
    throw converter.complaint(1 + static_cast<int>(std::count(text.begin(), control, '\n')), "",
                              "control character {}; allowed: UTF-8 text",
                              static_cast<unsigned char>(*control));
  }
  try {
    const std::vector<YAML::Node> documents = YAML::LoadAll(std::string(text));
    if (documents.empty()) return YamlNode{};
    if (documents.size() > 1) {
      throw converter.complaint(documents[1].Mark().line + 1, "",
                                "a second document begins; allowed: one");
    }
    return converter.convert(documents[0], 1, path, 0);
  } catch (const YAML::Exception& error) {
    throw converter.complaint(error.mark.line + 1, "", "not YAML: {}", error.msg);
  }
}

void emit(YAML::Emitter& out, const YamlNode& node) {
  switch (node.kind) {
    case YamlNode::Kind::null:
      out << YAML::Null;
      break;
    case YamlNode::Kind::scalar:
      if (node.quoted) out << YAML::DoubleQuoted;
      out << node.scalar;
      break;
    case YamlNode::Kind::list: {
      const bool flat = std::none_of(node.children.begin(), node.children.end(),
                                     [](const auto& c) { return c.kind == YamlNode::Kind::map; });
      if (flat) out << YAML::Flow;
      out << YAML::BeginSeq;
      for (const YamlNode& child : node.children) emit(out, child);
      out << YAML::EndSeq;
      break;
    }
    case YamlNode::Kind::map:
      if (node.children.empty()) out << YAML::Flow;
      out << YAML::BeginMap;
      for (std::size_t i = 0; i < node.keys.size(); ++i) {
        out << YAML::Key << node.keys[i] << YAML::Value;
        emit(out, node.children[i]);
      }
      out << YAML::EndMap;
      break;
  }
}

std::string emitted(const YamlNode& node, bool on_one_line) {
  YAML::Emitter out;
  out.SetNullFormat(YAML::LowerNull);
  if (on_one_line) {
    out.SetMapFormat(YAML::Flow);
    out.SetSeqFormat(YAML::Flow);
  }
  emit(out, node);
  if (!out.good()) throw std::logic_error("YAML emitter: " + out.GetLastError());
  return out.c_str();
}

}  // namespace

const YamlNode* YamlNode::find(std::string_view key) const {
  const auto found = std::find(keys.begin(), keys.end(), key);
  return found == keys.end() ? nullptr : &children[static_cast<std::size_t>(found - keys.begin())];
}

YamlNode& YamlNode::add(std::string key) {
  keys.push_back(std::move(key));
  return children.emplace_back();
}

YamlNode parse_yaml(std::string_view text, const std::string& source) {
  return parse(text, source, true, "");
}

void apply_override(YamlNode& root, const std::string& assignment) {
  const std::string where = "--set " + assignment;
  const auto refuse = [&](std::string_view problem) {
    return diagnostics::bad_usage("{}: {}", where, problem);
  };
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos) throw refuse("no '='; write key.path=value");
  const std::string path = assignment.substr(0, equals);
  const std::string value = assignment.substr(equals + 1);
  if (value.find_first_not_of(" \t\r\n") == std::string::npos) {
    throw refuse("no value; write key.path=value (null for none)");
  }
  YamlNode* node = &root;
  for (std::size_t begin = 0; begin <= path.size();) {
    const std::size_t end = std::min(path.find('.', begin), path.size());
    const std::string key = path.substr(begin, end - begin);
    if (key.empty()) throw refuse("an empty name in the key; write key.path=value");
    if (node->kind != YamlNode::Kind::map) {
      *node = YamlNode{};
      node->kind = YamlNode::Kind::map;
      node->where = where;
    }
    YamlNode* const child = node->find(key);
    node = child != nullptr ? child : &node->add(key);
    if (child == nullptr) node->where = where;
    begin = end + 1;
  }
  *node = parse(value, where, false, path);
}

std::string emit_yaml(const YamlNode& node) { return emitted(node, false) + "\n"; }

std::string emit_line(const YamlNode& node) {
  std::size_t longest = 80;
  std::string line = emitted(node, true);
  std::replace(line.begin(), line.end(), '\n', ' ');
  if (line.size() <= longest) return line;
  while ((static_cast<unsigned char>(line[longest]) & 0xc0) == 0x80) --longest;  // inside UTF-8
  return line.substr(0, longest) + "…";
}

}  // namespace tachless::experiment
