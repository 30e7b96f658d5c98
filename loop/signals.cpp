#include "loop/signals.h"

namespace tachless::loop {

std::string text_of(std::span<const Signal> signals) {
  std::string text;
  for (const Signal& signal : signals) {
    if (!text.empty()) text += ',';
    text.append(signal.name).append(1, ':').append(signal.unit);
  }
  return text;
}

std::optional<std::vector<Signal>> parse_signals(std::string_view text) {
  std::vector<Signal> signals;
  while (!text.empty()) {
    const std::string_view entry = text.substr(0, text.find(','));
    const bool last = entry.size() == text.size();
    text.remove_prefix(last ? entry.size() : entry.size() + 1);
    const std::size_t colon = entry.find(':');
    if (colon == 0 || colon == std::string_view::npos ||
        entry.find(':', colon + 1) != std::string_view::npos || (!last && text.empty()) ||
        signals.size() == max_signals) {
      return std::nullopt;
    }
    signals.push_back({entry.substr(0, colon), entry.substr(colon + 1)});
  }
  return signals;
}

}  // namespace tachless::loop
