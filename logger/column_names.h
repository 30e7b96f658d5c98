#pragma once

#include <string>
#include <string_view>
#include <vector>

/// How the columns of exported tables are called.
namespace tachless::logger {

/// What stands for the joints in the columns' names: their names, or their numbers from 1 where two
/// columns would be called the same ("q_ref" of joint "a", and "q" of one called "ref_a").
std::vector<std::string> joints_in_columns(const std::vector<std::string>& quantities,
                                           const std::vector<std::string>& joint_names);

/// "tau_elbow_Nm"; no `unit` where that is "1".
std::string column_name(std::string_view quantity, std::string_view joint, std::string_view unit);

}  // namespace tachless::logger
