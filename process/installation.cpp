#include "process/installation.h"

namespace tachless::process {

namespace fs = std::filesystem;

fs::path program_directory() { return fs::read_symlink("/proc/self/exe").parent_path(); }

fs::path shared_directory() { return program_directory().parent_path() / "share/tachless"; }

}  // namespace tachless::process
