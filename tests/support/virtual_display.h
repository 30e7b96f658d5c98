#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tests/support/program.h"

/// An X server without a screen, with what is needed to look at it: DISPLAY of this process is set
/// to it. Ended with the object.
class VirtualDisplay {
 public:
  /// @param more options of Xvfb
  explicit VirtualDisplay(const TemporaryDirectory& directory,
                          const std::vector<std::string>& more = {});

  /// The visible window of exactly that title, if there is one.
  [[nodiscard]] std::optional<std::string> window(const std::string& title) const;

  /// A picture of a window in any format that the path's ending names.
  void picture(const std::string& window, const std::filesystem::path& path) const;

  /// A double click at that place of a window [pixels].
  void double_click(const std::string& window, int x, int y) const;

 private:
  const TemporaryDirectory& directory_;
  Program server_;
};

/// The stdout of a program. @throw std::runtime_error with its stderr when it fails.
std::string output_of(const std::string& program, const std::vector<std::string>& arguments,
                      const TemporaryDirectory& directory);

/// The text in a picture, as a reader of texts reads it.
std::string text_in(const std::filesystem::path& picture, const TemporaryDirectory& directory);

/// The same, every character that is neither letter nor digit left out.
std::string letters_in(const std::filesystem::path& picture, const TemporaryDirectory& directory);

/// A grey picture in memory.
struct Picture {
  /// @throw std::runtime_error when the file is not a binary PGM of 8 bits.
  explicit Picture(const std::filesystem::path& path);
  [[nodiscard]] int at(int x, int y) const {
    return pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                  static_cast<std::size_t>(x)];
  }
  /// @throw std::out_of_range unless inside.
  [[nodiscard]] Picture part(int x, int y, int its_width, int its_height) const;
  void save(const std::filesystem::path& path) const;

  int width = 0, height = 0;
  std::vector<std::uint8_t> pixels;

 private:
  Picture() = default;
};
