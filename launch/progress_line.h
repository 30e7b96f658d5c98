#pragma once

#include <string_view>

namespace tachless::launch {

/// What a long computation is at, on stderr: on a terminal one line that the next replaces and that
/// goes with this object, elsewhere a line each. A run shows `Progress` instead.
class ProgressLine {
 public:
  explicit ProgressLine(bool quiet);
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;
  ~ProgressLine() { clear(); }

  void show(std::string_view what) const;
  void clear() const;

 private:
  bool quiet_;
  bool terminal_;
};

}  // namespace tachless::launch
