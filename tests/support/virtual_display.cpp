#include "tests/support/virtual_display.h"

#include <cctype>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <thread>

using std::chrono::steady_clock;

namespace {

std::vector<std::string> options_of_server(const std::vector<std::string>& more) {
  std::vector<std::string> options = {"-displayfd", "1", "-screen", "0", "1280x1000x24",
                                      "-nolisten", "tcp",
                                      // Else it starts anew whenever its last client has gone, and
                                      // drops one that comes meanwhile.
                                      "-noreset"};
  options.insert(options.end(), more.begin(), more.end());
  return options;
}

}  // namespace

VirtualDisplay::VirtualDisplay(const TemporaryDirectory& directory,
                               const std::vector<std::string>& more)
    : directory_(directory), server_("Xvfb", options_of_server(more), directory.path()) {
  wait_until("the X server's display number", [&] {
    if (!server_.running()) throw std::runtime_error("Xvfb: " + server_.errors());
    return server_.output().find('\n') != std::string::npos;
  });
  const std::string display = ":" + std::to_string(std::stoi(server_.output()));
  setenv("DISPLAY", display.c_str(), 1);
}

std::optional<std::string> VirtualDisplay::window(const std::string& title) const {
  // xdotool fails when it finds none.
  Program search("xdotool", {"search", "--onlyvisible", "--name", "^" + title + "$"},
                 directory_.path());
  if (search.wait() != 0) return std::nullopt;
  std::istringstream found(search.output());
  std::string id;
  found >> id;
  return id;
}

void VirtualDisplay::picture(const std::string& window, const std::filesystem::path& path) const {
  // Cut from the root window: of a window that has closed meanwhile, xdotool says so at once, where
  // `import -window ID` waits for somebody to click on another one.
  std::istringstream geometry(
      output_of("xdotool", {"getwindowgeometry", "--shell", window}, directory_));
  std::map<std::string, std::string> value;
  for (std::string line; std::getline(geometry, line);) {
    const auto equals = line.find('=');
    if (equals != std::string::npos) value[line.substr(0, equals)] = line.substr(equals + 1);
  }
  const std::string part =
      value.at("WIDTH") + "x" + value.at("HEIGHT") + "+" + value.at("X") + "+" + value.at("Y");
  output_of("import", {"-window", "root", "-crop", part, "+repage", "-depth", "8", path},
            directory_);
}

void VirtualDisplay::double_click(const std::string& window, int x, int y) const {
  output_of("xdotool",
            {"mousemove", "--window", window, std::to_string(x), std::to_string(y), "click",
             "--repeat", "2", "--delay", "60", "1"},
            directory_);
}

std::string output_of(const std::string& program, const std::vector<std::string>& arguments,
                      const TemporaryDirectory& directory) {
  Program tool(program, arguments, directory.path());
  if (tool.wait() != 0) throw std::runtime_error(program + ": " + tool.errors());
  return tool.output();
}

std::string text_in(const std::filesystem::path& picture, const TemporaryDirectory& directory) {
  const std::string large = directory / "large.png";
  output_of("convert",
            {picture, "-colorspace", "Gray", "-auto-level", "-resize", "400%", "-bordercolor",
             "white", "-border", "20", large},
            directory);
  return output_of("tesseract", {large, "-", "--psm", "6"}, directory);
}

std::string letters_in(const std::filesystem::path& picture, const TemporaryDirectory& directory) {
  std::string letters;
  for (const char c : text_in(picture, directory)) {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0) letters += c;
  }
  return letters;
}

Picture::Picture(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string magic;
  int largest = 0;
  file >> magic >> width >> height >> largest;
  file.get();
  if (!file || magic != "P5" || largest != 255 || width <= 0 || height <= 0) {
    throw std::runtime_error(path.string() + " is no grey picture");
  }
  pixels.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  file.read(reinterpret_cast<char*>(pixels.data()), static_cast<std::streamsize>(pixels.size()));
  if (!file) throw std::runtime_error(path.string() + " is cut short");
}

Picture Picture::part(int x, int y, int its_width, int its_height) const {
  if (x < 0 || y < 0 || x + its_width > width || y + its_height > height) {
    throw std::out_of_range("part of a picture");
  }
  Picture result;
  result.width = its_width;
  result.height = its_height;
  for (int row = y; row < y + its_height; ++row) {
    for (int column = x; column < x + its_width; ++column) {
      result.pixels.push_back(static_cast<std::uint8_t>(at(column, row)));
    }
  }
  return result;
}

void Picture::save(const std::filesystem::path& path) const {
  std::ofstream file(path, std::ios::binary);
  file << "P5\n" << width << " " << height << "\n255\n";
  file.write(reinterpret_cast<const char*>(pixels.data()),
             static_cast<std::streamsize>(pixels.size()));
  if (!file) throw std::runtime_error("cannot write " + path.string());
}
