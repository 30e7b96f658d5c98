#pragma once

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <random>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tachless::scenario {

/// Draws that are the same with every library.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : engine_(seed) {}
  std::size_t below(std::size_t count) { return engine_() % count; }
  template <class List>
  const auto& one_of(const List& list) {
    return list[below(std::size(list))];
  }

 private:
  std::mt19937_64 engine_;
};

/// A text with one mistake.
struct Mutation {
  std::string kind, text;
};

/// Returns `word` with one character lost, doubled, exchanged or in the other case.
inline std::string misspelt(std::string word, Draw& draw) {
  const std::size_t at = draw.below(word.size());
  const auto c = static_cast<unsigned char>(word[at]);
  switch (draw.below(4)) {
    case 0:
      return word.erase(at, 1);
    case 1:
      return word.insert(at, 1, word[at]);
    case 2:
      word[at] = c == 'q' ? 'w' : 'q';
      return word;
    default:
      word[at] = static_cast<char>(std::isupper(c) ? std::tolower(c) : std::toupper(c));
  }
  return word;
}

/// An XML file of elements, cut into tags. Mutations leave numbers and names valid or spoil them:
/// none of them is a file that describes another robot rightly.
class XmlMutator {
 public:
  struct Attribute {
    std::size_t name = 0, name_end = 0, value = 0, value_end = 0;
  };
  struct Element {
    std::string name;
    int parent = -1;
    std::size_t begin = 0, end = 0;       ///< of the whole element
    std::size_t open_end = 0, close = 0;  ///< of the opening tag; begin of the closing tag or `end`
    std::vector<Attribute> attributes;
  };

  /// @param allowed moves that make the right file of another robot: "robot/link" for an element
  /// in another, "origin@rpy" for an attribute of an element
  XmlMutator(std::string text, std::set<std::string> allowed)
      : text_(std::move(text)), allowed_(std::move(allowed)) {
    std::vector<int> open;
    for (std::size_t at = text_.find('<'); at != std::string::npos; at = text_.find('<', at + 1)) {
      const std::size_t end = text_.find('>', at) + 1;
      if (text_[at + 1] == '?' || text_[at + 1] == '!') continue;
      if (text_[at + 1] == '/') {
        elements_[static_cast<std::size_t>(open.back())].close = at;
        elements_[static_cast<std::size_t>(open.back())].end = end;
        open.pop_back();
        continue;
      }
      Element e{name_at(at + 1), open.empty() ? -1 : open.back(), at, end, end, end, {}};
      add_attributes(e);
      if (text_[end - 2] != '/') open.push_back(static_cast<int>(elements_.size()));
      elements_.push_back(std::move(e));
    }
  }

  Mutation mutation(Draw& draw) const {
    static constexpr std::array kinds{&XmlMutator::misspell_attribute,
                                      &XmlMutator::misspell_element,
                                      &XmlMutator::rename,
                                      &XmlMutator::double_attribute,
                                      &XmlMutator::double_element,
                                      &XmlMutator::spoil_number,
                                      &XmlMutator::spoil_reference,
                                      &XmlMutator::add_text,
                                      &XmlMutator::wrap,
                                      &XmlMutator::move,
                                      &XmlMutator::add_tag,
                                      &XmlMutator::spoil_character,
                                      &XmlMutator::add_prefix,
                                      &XmlMutator::move_attribute,
                                      &XmlMutator::write_otherwise};
    return (this->*draw.one_of(kinds))(draw);
  }

 private:
  [[nodiscard]] std::string name_at(std::size_t at) const {
    return text_.substr(at, text_.find_first_of(" \t\n/>", at) - at);
  }
  void add_attributes(Element& e) const {
    for (std::size_t at = text_.find('=', e.begin); at < e.open_end; at = text_.find('=', at)) {
      const std::size_t name = text_.find_last_of(" \t\n", at) + 1;
      const std::size_t end = text_.find('"', at + 2);
      e.attributes.push_back({name, at, at + 2, end});
      at = end;
    }
  }
  [[nodiscard]] std::string with(std::size_t begin, std::size_t end, std::string_view now) const {
    return text_.substr(0, begin) + std::string(now) + text_.substr(end);
  }
  [[nodiscard]] std::string part(std::size_t begin, std::size_t end) const {
    return text_.substr(begin, end - begin);
  }

  /// An element that is no root.
  const Element& element(Draw& draw) const {
    return elements_[1 + draw.below(elements_.size() - 1)];
  }
  /// An element whose attribute `wants` accepts, and that attribute.
  template <class Wants>
  std::pair<const Element*, Attribute> attribute(Draw& draw, const Wants& wants) const {
    while (true) {
      const Element& e = element(draw);
      if (e.attributes.empty()) continue;
      const Attribute a = draw.one_of(e.attributes);
      if (wants(part(a.name, a.name_end), part(a.value, a.value_end))) return {&e, a};
    }
  }
  static bool any(const std::string& /*name*/, const std::string& /*value*/) { return true; }
  static bool is_number(const std::string& name, const std::string& value) {
    return name != "name" && value.find_first_not_of("0123456789.-+e ") == std::string::npos;
  }
  [[nodiscard]] std::string renamed(const Element& e, const std::string& name) const {
    std::string text = text_;
    if (e.close != e.end) text.replace(e.close + 2, e.name.size(), name);
    return text.replace(e.begin + 1, e.name.size(), name);
  }
  /// A place between two tags.
  std::size_t between(Draw& draw) const {
    const Element& e = draw.one_of(elements_);
    return draw.below(2) == 0 || e.begin == elements_[0].begin ? e.open_end : e.begin;
  }

  Mutation misspell_attribute(Draw& draw) const {
    const Attribute a = attribute(draw, any).second;
    return {"attribute misspelt",
            with(a.name, a.name_end, misspelt(part(a.name, a.name_end), draw))};
  }
  Mutation misspell_element(Draw& draw) const {
    const Element& e = element(draw);
    return {"element misspelt", renamed(e, misspelt(e.name, draw))};
  }
  /// Gives an attribute or element the name that another format has for it.
  Mutation rename(Draw& draw) const {
    static constexpr std::array<std::pair<std::string_view, std::string_view>, 22> names{
        {{"xyz", "pos"},          {"xyz", "position"},     {"xyz", "translation"},
         {"rpy", "euler"},        {"rpy", "rotation"},     {"rpy", "quat"},
         {"lower", "min"},        {"upper", "max"},        {"effort", "torque"},
         {"velocity", "speed"},   {"value", "mass"},       {"damping", "viscous"},
         {"friction", "coulomb"}, {"multiplier", "ratio"}, {"ixx", "xx"},
         {"origin", "pose"},      {"limit", "limits"},     {"dynamics", "friction"},
         {"mass", "weight"},      {"inertia", "moments"},  {"inertial", "dynamics"},
         {"mimic", "gear"}}};
    for (std::size_t tries = 0; tries < 100; ++tries) {
      const auto& [from, to] = draw.one_of(names);
      const Element& e = element(draw);
      if (e.name == from) return {"element of another format", renamed(e, std::string(to))};
      for (const Attribute& a : e.attributes) {
        if (part(a.name, a.name_end) == from) {
          return {"attribute of another format", with(a.name, a.name_end, to)};
        }
      }
    }
    return misspell_attribute(draw);
  }
  Mutation double_attribute(Draw& draw) const {
    const Attribute a = attribute(draw, any).second;
    return {"attribute doubled", with(a.name, a.name, part(a.name, a.name_end) + "=\"0.25 0 0\" ")};
  }
  Mutation double_element(Draw& draw) const {
    const Element& e = element(draw);
    std::string copy = part(e.begin, e.end);
    if (const std::size_t digit = copy.find_first_of("123456789"); digit != std::string::npos) {
      copy[digit] = copy[digit] == '3' ? '4' : '3';
    }
    const std::size_t at = draw.below(2) == 0 ? e.begin : e.end;
    return {"element doubled", with(at, at, copy)};
  }
  Mutation spoil_number(Draw& draw) const {
    const Attribute a = attribute(draw, is_number).second;
    const std::string value = part(a.value, a.value_end);
    const std::size_t at = draw.below(value.size());
    static constexpr std::array<std::string_view, 9> inserted{",", ";",  ". .",          "x", "O",
                                                              "m", "--", "\xe2\x88\x92", "_"};
    static constexpr std::array<std::string_view, 10> whole{
        "", " ", "nan", "inf", "1e999", "0x1p-1", "1,5", "-", "1 2", "1 2 3 4"};
    std::string now = value;
    switch (draw.below(4)) {
      case 0:
        now.insert(at, draw.one_of(inserted));
        break;
      case 1:
        now = draw.one_of(whole);
        break;
      case 2:
        now += draw.below(2) == 0 ? "deg" : " 0";
        break;
      default:
        if (const std::size_t point = now.find('.'); point != std::string::npos)
          now[point] = ',';
        else
          now += ",0";
    }
    return {"number spoilt", with(a.value, a.value_end, now)};
  }
  Mutation spoil_reference(Draw& draw) const {
    const auto [e, a] = attribute(draw, [](const std::string& name, const std::string& value) {
      return name != "name" && !is_number(name, value);
    });
    return {"reference misspelt",
            with(a.value, a.value_end, misspelt(part(a.value, a.value_end), draw))};
  }
  Mutation add_text(Draw& draw) const {
    static constexpr std::array<std::string_view, 5> texts{"0.5 0 0", "xyz=\"1 0 0\"", "/>", ">",
                                                           "text"};
    const std::size_t at = between(draw);
    return {"text added", with(at, at, draw.one_of(texts))};
  }
  Mutation wrap(Draw& draw) const {
    static constexpr std::array<std::string_view, 6> names{"group", "model", "frame",
                                                           "body",  "robot", "x"};
    const std::size_t first = 1 + draw.below(elements_.size() - 1);
    const Element& e = elements_[first];
    std::size_t end = e.end;  // or that of its next sibling
    for (std::size_t next = first + 1; next < elements_.size() && draw.below(2) == 0; ++next) {
      if (elements_[next].parent == e.parent) {
        end = elements_[next].end;
        break;
      }
    }
    const std::string name(draw.one_of(names));
    return {"wrapped in <" + name + ">",
            with(e.begin, end, "<" + name + ">" + part(e.begin, end) + "</" + name + ">")};
  }
  Mutation move(Draw& draw) const {
    while (true) {
      const Element& e = element(draw);
      const Element& to = draw.one_of(elements_);
      if (to.close == to.end || allowed_.contains(to.name + "/" + e.name)) continue;
      if (to.close >= e.begin && to.close <= e.end) continue;
      std::string text = text_;
      const std::string moved = part(e.begin, e.end);
      if (to.close > e.end) {
        text.insert(to.close, moved).erase(e.begin, moved.size());
      } else {
        text.erase(e.begin, moved.size()).insert(to.close, moved);
      }
      return {"<" + e.name + "> moved into <" + to.name + ">", text};
    }
  }
  Mutation add_tag(Draw& draw) const {
    const Element& e = draw.one_of(elements_);
    const std::size_t at = between(draw);
    const std::string tag = draw.below(2) == 0 ? "</" + e.name + ">" : part(e.begin, e.open_end);
    if (tag.ends_with("/>")) return double_element(draw);
    return {"tag " + tag + " added", with(at, at, tag)};
  }
  /// Loses, doubles or exchanges a character outside of values.
  Mutation spoil_character(Draw& draw) const {
    static constexpr std::string_view others = "<>/=\"' !?&;-x\n";
    while (true) {
      const std::size_t at = draw.below(text_.size());
      const bool in_value = std::ranges::any_of(elements_, [&](const Element& e) {
        return std::ranges::any_of(
            e.attributes, [&](const Attribute& a) { return at >= a.value && at < a.value_end; });
      });
      if (in_value) continue;
      const std::string other(1, draw.one_of(others));
      switch (draw.below(3)) {
        case 0:
          return {"character lost", with(at, at + 1, "")};
        case 1:
          return {"character " + other + " added", with(at, at, other)};
        default:
          return {"character " + other, with(at, at + 1, other)};
      }
    }
  }
  Mutation add_prefix(Draw& draw) const {
    const Element& e = element(draw);
    return {"prefix", renamed(e, "drake:" + e.name)};
  }
  Mutation move_attribute(Draw& draw) const {
    const Attribute a = attribute(draw, any).second;
    const Element& to = draw.one_of(elements_);
    const std::string name = part(a.name, a.name_end);
    for (const Attribute& own : to.attributes) {
      if (part(own.name, own.name_end) == name) return misspell_attribute(draw);
    }
    if (allowed_.contains(to.name + "@" + name)) return misspell_attribute(draw);
    const std::size_t at = to.begin + 1 + to.name.size();
    const std::string moved = " " + part(a.name, a.value_end + 1);
    std::string text = text_;
    if (at > a.name) {
      text.insert(at, moved).erase(a.name, a.value_end + 1 - a.name);
    } else {
      text.erase(a.name, a.value_end + 1 - a.name).insert(at, moved);
    }
    return {"attribute " + name + " moved into <" + to.name + ">", text};
  }
  /// Writes an attribute in another way that is right.
  Mutation write_otherwise(Draw& draw) const {
    const Attribute a = attribute(draw, is_number).second;
    const std::string value = part(a.value, a.value_end);
    switch (draw.below(4)) {
      case 0:
        return {"blanks", with(a.value, a.value_end, " \t" + value + " \n")};
      case 1:
        return {"exponent", with(a.value_end, a.value_end, "e0")};
      case 2:
        return {"plus", with(a.value, a.value, "+")};
      default:
        return {"single quotes", with(a.value - 1, a.value_end + 1, "'" + value + "'")};
    }
  }

  std::string text_;
  std::set<std::string> allowed_;
  std::vector<Element> elements_;
};

}  // namespace tachless::scenario
