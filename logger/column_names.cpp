#include "logger/column_names.h"

#include <set>

namespace tachless::logger {

std::string column_name(std::string_view quantity, std::string_view joint, std::string_view unit) {
  std::string text(quantity);
  if (!joint.empty()) text.append(1, '_').append(joint);
  if (unit != "1") text.append(1, '_').append(unit);
  return text;
}

std::vector<std::string> joints_in_columns(const std::vector<std::string>& quantities,
                                           const std::vector<std::string>& joint_names) {
  std::set<std::string> different;
  std::vector<std::string> numbers;
  for (const std::string& joint : joint_names) {
    for (const std::string& quantity : quantities) {
      different.insert(column_name(quantity, joint, "1"));
    }
    numbers.push_back(std::to_string(numbers.size() + 1));
  }
  return different.size() == quantities.size() * joint_names.size() ? joint_names : numbers;
}

}  // namespace tachless::logger
