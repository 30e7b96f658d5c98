#include "scenario/description.h"

#include <stdexcept>
#include <utility>

#include "base/failure.h"
#include "base/file_text.h"
#include "scenario/xacro.h"

namespace tachless::scenario {

namespace fs = std::filesystem;

robot::IncludedText files_beside(const fs::path& mjcf) {
  return [folder = mjcf.parent_path()](const std::string& name) {
    return base::given_text(folder / name, base::max_text_bytes);
  };
}

robot::Description read_description(const fs::path& file,
                                    const std::map<std::string, std::string>& xacro_arguments) {
  robot::Description description;
  description.urdf = urdf_text(file, xacro_arguments);
  if (!robot::is_mjcf(description.urdf)) return description;
  try {
    std::string mjcf = std::move(description.urdf);
    description = robot::description_of_mjcf(mjcf, file.string(), files_beside(file));
    description.mjcf = std::move(mjcf);
    return description;
  } catch (const std::invalid_argument& refused) {
    throw base::bad_usage("{}", refused.what());
  }
}

}  // namespace tachless::scenario
