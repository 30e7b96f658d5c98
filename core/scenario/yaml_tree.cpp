#include "scenario/yaml_tree.h"

#include <fmt/format.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <map>
#include <optional>
#include <sstream>
#include <stdexcept>

#include "base/failure.h"
#include "base/file_text.h"
#include "base/text.h"

namespace tachless::scenario {
namespace {

// Aliases can make a short text unfold into a huge tree, or into an endless one.
constexpr int max_nodes = 20'000;
constexpr std::size_t max_depth = 32;
constexpr std::size_t max_key_bytes = 100;

/// Makes the tree of one document from yaml-cpp's events; every bound is checked before memory is
/// taken. yaml-cpp's own loader reads endless empty documents where a ',' follows the first.
class Builder : public YAML::EventHandler {
 public:
  /// @param source of a file its name; else the "--set key=value" that stands in for "file:line"
  /// @param path of the value, for messages
  Builder(std::string_view text, const std::string& source, bool of_file, const std::string& path)
      : source_(source), of_file_(of_file), path_(path) {
    if (text.size() > base::max_text_bytes) {
      throw complaint(1, "{} bytes; allowed: at most {}", text.size(), base::max_text_bytes);
    }
    // yaml-cpp takes byte 4 for the end of the text, and a NUL would not survive a message.
    const auto control = std::find_if(text.begin(), text.end(), [](char c) {
      return (static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\r' && c != '\t') ||
             c == 0x7f;
    });
    if (control != text.end()) {
      throw complaint(1 + static_cast<int>(std::count(text.begin(), control, '\n')),
                      "control character {}; allowed: UTF-8 text",
                      static_cast<unsigned char>(*control));
    }
    try {
      std::istringstream stream{std::string(text)};
      YAML::Parser parser(stream);
      while (parser.HandleNextDocument(*this)) continue;
      if (refused_) throw *refused_;
    } catch (const YAML::Exception& error) {
      open_.clear();
      const auto line = text.substr(text.rfind('\n', static_cast<std::size_t>(error.mark.pos)) + 1);
      const bool tab = line.substr(0, line.find_first_not_of(" \t")).find('\t') != line.npos;
      throw complaint(error.mark.line + 1, "not YAML: {}{}", error.msg,
                      tab ? "; indent by blanks, not tabs" : "");
    }
  }

  YamlNode take() { return std::move(root_); }

  void OnDocumentStart(const YAML::Mark& mark) override {
    if (std::exchange(begun_, true)) {
      throw complaint(line_of(mark),
                      "a second document begins; allowed: one (is there a bracket too many?)");
    }
  }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override { add(mark, anchor, {}); }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    const auto found = anchored_.find(anchor);
    if (!refused_ && found == anchored_.end()) {
      throw complaint(line_of(mark),
                      "an alias inside the value that it names; write the value out");
    }
    if (!refused_) add(mark, YAML::NullAnchor, found->second);
  }
  void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                const std::string& value) override {
    require_no_tag(mark, tag);
    add(mark, anchor, {YamlNode::Kind::scalar, value, tag == "!"});
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value /*style*/) override {
    begin(mark, tag, anchor, YamlNode::Kind::list);
  }
  void OnSequenceEnd() override { end(); }
  void OnMapStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value /*style*/) override {
    begin(mark, tag, anchor, YamlNode::Kind::map);
  }
  void OnMapEnd() override { end(); }

 private:
  /// A list or map that is being read. Its address stays: only the innermost one grows.
  struct Open {
    YamlNode* node;
    YAML::anchor_t anchor;
    int line;
    bool has_key = false;  ///< the map's last key waits for its value
    int key_line = 0;
  };

  static int line_of(const YAML::Mark& mark) { return mark.line + 1; }
  [[nodiscard]] std::string where(int line) const {
    return of_file_ ? fmt::format("{}:{}", source_, line) : source_;
  }
  template <class... Args>
  [[nodiscard]] base::Failure complaint(int line, fmt::format_string<Args...> problem,
                                        Args&&... args) const {
    std::string path = path_;
    for (const Open& open : open_) {
      const bool innermost = &open == &open_.back();
      if (open.node->kind == YamlNode::Kind::list) {
        path += fmt::format("[{}]", open.node->children.size() - (innermost ? 0 : 1));
      } else if (!innermost || open.has_key) {
        path += (path.empty() ? "" : ".") + open.node->keys.back();
      }
    }
    return base::bad_usage("{}: {}{}{}", where(line), path, path.empty() ? "" : ": ",
                           fmt::format(problem, std::forward<Args>(args)...));
  }
  void require_no_tag(const YAML::Mark& mark, const std::string& tag) const {
    if (tag.empty() || tag == "?" || tag == "!") return;
    throw complaint(line_of(mark), "tag '{}' is not known; write the value without a tag", tag);
  }

  /// Counts a node, and what an alias brings with it.
  void count(const YamlNode& node, std::size_t depth, int line) {
    num_bytes_ += node.scalar.size();
    if (++num_nodes_ > max_nodes || depth > max_depth || num_bytes_ > base::max_text_bytes) {
      throw complaint(line,
                      "too large or nested too deeply; allowed: {} values, {} bytes, {} levels, "
                      "aliases included",
                      max_nodes, base::max_text_bytes, max_depth);
    }
    for (const YamlNode& child : node.children) count(child, depth + 1, line);
  }

  [[nodiscard]] bool at_key() const {
    return !open_.empty() && open_.back().node->kind == YamlNode::Kind::map &&
           !open_.back().has_key;
  }
  void take_key(int line, const YamlNode& node) {
    Open& map = open_.back();
    if (node.kind != YamlNode::Kind::scalar || node.scalar.empty()) {
      throw complaint(line, "a key must be a word");
    }
    if (node.scalar.size() > max_key_bytes) {
      throw complaint(line, "a key of {} bytes; allowed: at most {}", node.scalar.size(),
                      max_key_bytes);
    }
    const YamlNode* const first = map.node->find(node.scalar);
    const std::string first_line =
        first != nullptr && of_file_ ? "; first in line " + first->where.substr(source_.size() + 1)
                                     : "";
    map.node->keys.push_back(node.scalar);
    map.has_key = true;
    map.key_line = line;
    if (first != nullptr) throw complaint(line, "given twice{}", first_line);
  }

  /// Puts a value in its place. @return the place, and the line it is named by
  std::pair<YamlNode*, int> put(int line, YamlNode node) {
    count(node, open_.size(), line);
    YamlNode* to = &root_;
    if (open_.empty()) line = 1;
    if (!open_.empty()) {
      Open& in = open_.back();
      line = in.node->kind == YamlNode::Kind::map ? in.key_line : std::max(in.line, line);
      in.has_key = false;
      to = &in.node->children.emplace_back();
    }
    *to = std::move(node);
    to->where = where(line);
    return {to, line};
  }
  void add(const YAML::Mark& mark, YAML::anchor_t anchor, YamlNode node) {
    if (refused_) return;
    if (anchor != YAML::NullAnchor) anchored_[anchor] = node;
    if (at_key()) return take_key(line_of(mark), node);
    put(line_of(mark), std::move(node));
  }
  void begin(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
             YamlNode::Kind kind) {
    if (at_key()) refused_ = complaint(line_of(mark), "a key must be a word");
    if (refused_) return;
    require_no_tag(mark, tag);
    const auto [to, line] = put(line_of(mark), {kind});
    open_.push_back({to, anchor, line});
  }
  void end() {
    if (refused_) return;
    const Open& done = open_.back();
    if (done.anchor != YAML::NullAnchor) anchored_[done.anchor] = *done.node;
    open_.pop_back();
  }

  const std::string& source_;
  const bool of_file_;
  const std::string path_;
  YamlNode root_;
  std::vector<Open> open_;
  std::map<YAML::anchor_t, YamlNode> anchored_;
  /// A list or map as a key; an error of syntax that comes later is the better message: "[1".
  std::optional<base::Failure> refused_;
  bool begun_ = false;
  int num_nodes_ = 0;
  std::size_t num_bytes_ = 0;
};

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
  return Builder(text, source, true, "").take();
}

void apply_override(YamlNode& root, const std::string& assignment) {
  // Every node of the value has it, so that a long value would be copied for each of its numbers.
  constexpr std::size_t longest = 500;
  const std::string where =
      "--set " + (assignment.size() > longest ? assignment.substr(0, longest) + "..." : assignment);
  const auto refuse = [&](std::string_view problem) {
    return base::bad_usage("{}: {}", where, problem);
  };
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos) throw refuse("no '='; write key.path=value");
  const std::string path = assignment.substr(0, equals);
  const std::string value = assignment.substr(equals + 1);
  if (value.find_first_not_of(" \t\r\n") == std::string::npos) {
    throw refuse("no value; write key.path=value (null for none)");
  }
  YamlNode* node = &root;
  for (const std::string_view key : base::split(path, '.')) {
    if (key.empty()) throw refuse("an empty name in the key; write key.path=value");
    if (node->kind != YamlNode::Kind::map) *node = {.kind = YamlNode::Kind::map, .where = where};
    YamlNode* const child = node->find(key);
    node = child != nullptr ? child : &node->add(std::string(key));
    if (child == nullptr) node->where = where;
  }
  *node = Builder(value, where, false, path).take();
}

std::string text_override(std::string_view key, const std::string& text) {
  return fmt::format("{}={}", key, emitted({YamlNode::Kind::scalar, text}, true));
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

}  // namespace tachless::scenario
