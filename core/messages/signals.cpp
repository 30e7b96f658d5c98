#include "messages/signals.h"

#include <algorithm>

namespace tachless::messages {

std::string text_of(std::span<const Signal> signals) {
  std::string text;
  for (const Signal& signal : signals) {
    if (!text.empty()) text += ',';
    text.append(signal.name).append(1, ':').append(signal.unit);
  }
  return text;
}

namespace {

bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }
bool is_control(char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }

/// Returns whether the text is an identifier. Names end in figures, tables and files of other
/// programs, for which identifiers are safe.
bool is_identifier(std::string_view text) {
  return !text.empty() && is_letter(text.front()) &&
         std::all_of(text.begin(), text.end(),
                     [](char c) { return is_letter(c) || (c >= '0' && c <= '9') || c == '_'; });
}

/// Calls `each` with every signal of the text.
/// @return whether the text lists signals
template <class Each>
bool read_signals(std::string_view text, const Each& each) {
  for (int count = 0; !text.empty(); ++count) {
    const std::string_view entry = text.substr(0, text.find(','));
    const bool last = entry.size() == text.size();
    text.remove_prefix(last ? entry.size() : entry.size() + 1);
    const std::size_t colon = entry.find(':');
    if (colon == std::string_view::npos || (!last && text.empty()) || count == max_signals) {
      return false;
    }
    const std::string_view name = entry.substr(0, colon), unit = entry.substr(colon + 1);
    if (!is_identifier(name) || unit.find(':') != std::string_view::npos ||
        std::any_of(unit.begin(), unit.end(), is_control)) {
      return false;
    }
    each(name, unit);
  }
  return true;
}

}  // namespace

bool are_signals(std::string_view text) {
  return read_signals(text, [](std::string_view, std::string_view) {});
}

std::optional<std::vector<Signal>> parse_signals(std::string_view text) {
  std::vector<Signal> signals;
  const auto add = [&](std::string_view name, std::string_view unit) {
    signals.push_back({name, unit});
  };
  if (!read_signals(text, add)) return std::nullopt;
  return signals;
}

}  // namespace tachless::messages
