#include "scenario/model_pin.h"

#include <fmt/format.h>

#include <set>

#include "base/file_text.h"
#include "base/fnv.h"
#include "robot/mjcf_scene.h"

namespace tachless::scenario {
namespace {

namespace fs = std::filesystem;

constexpr const char* model_key = "plant.mujoco.model";

/// Continues a digest with a file and the files that it includes, each once.
std::uint64_t model_digest(const fs::path& file, const fs::path& folder, std::set<fs::path>& seen,
                           std::uint64_t hash) {
  const std::string text = base::given_text(file, base::max_text_bytes);
  hash = base::fnv(text, hash);
  for (const std::string& name : robot::included_files(text)) {
    const fs::path included = folder / name;
    if (seen.insert(included).second) hash = model_digest(included, folder, seen, hash);
  }
  return hash;
}

}  // namespace

void pin_model(YamlNode& root, const Scenario& scenario, const fs::path& directory) {
  YamlNode* node = &root;
  for (const char* each : {"plant", "mujoco", "model"}) {
    if (node != nullptr) node = node->find(each);
  }
  if (node == nullptr || node->kind != YamlNode::Kind::scalar) return;  // the reader says so
  const std::string name = without_digest(node->scalar);
  if (name.empty()) return;
  const fs::path file = directory / name;
  std::set<fs::path> seen;
  std::string pinned;
  try {
    pinned = fmt::format("{}@{:016x}", name,
                         model_digest(file, file.parent_path(), seen, base::fnv_of_nothing));
  } catch (const base::Failure& failure) {
    throw scenario.complaint(model_key, "{}", failure.what());
  }
  if (node->scalar != name && node->scalar != pinned) {
    throw scenario.complaint(model_key, "{}: the file is another model, {}; give that, or {}",
                             node->scalar, pinned, name);
  }
  node->scalar = pinned;
  node->quoted = true;
}

std::string without_digest(const std::string& model) {
  const std::size_t at = model.rfind('@');
  const bool pinned = at != std::string::npos && model.size() == at + 17 &&
                      model.find_first_not_of("0123456789abcdef", at + 1) == std::string::npos;
  return pinned ? model.substr(0, at) : model;
}

}  // namespace tachless::scenario
