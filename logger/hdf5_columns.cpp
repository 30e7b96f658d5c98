#include "logger/hdf5_columns.h"

#include <fmt/format.h>
#include <hdf5.h>
#include <hdf5_hl.h>

#include "diagnostics/failure.h"
#include "diagnostics/text.h"

namespace tachless::logger {

void write_hdf5_columns(const std::filesystem::path& path, const std::vector<NumberColumn>& columns,
                        const std::map<std::string, std::string>& texts) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  const auto check = [&](auto result) {
    if (result >= 0) return result;
    throw diagnostics::bad_usage(
        "{}: cannot write: the file system refused; check directory, rights, limits and room",
        path.string());
  };
  const hid_t file = check(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
  for (const auto& [name, text] : texts) {
    check(H5LTmake_dataset_string(file, name.c_str(), text.c_str()));
  }
  for (const NumberColumn& column : columns) {
    const hsize_t size = column.values.size();
    const char* name = column.name.c_str();
    check(H5LTmake_dataset_double(file, name, 1, &size, column.values.data()));
    check(H5LTset_attribute_string(file, name, "unit", column.unit.c_str()));
    if (column.choices.empty()) continue;
    check(H5LTset_attribute_string(file, name, "choices",
                                   diagnostics::joined(column.choices, ",").c_str()));
  }
  check(H5Fclose(file));
}

}  // namespace tachless::logger
