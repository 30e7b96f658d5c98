#pragma once

#include <exception>
#include <string_view>

#include "base/failure.h"

namespace tachless::base {

/// Calls a function that a user wrote and returns its result. An exception that is no Failure
/// becomes a Failure of code 5, because it stops the robot.
/// @param whose name of the user's code in messages, for example "the driver"
template <class Function>
auto call_users(std::string_view whose, const Function& function) -> decltype(function()) {
  try {
    return function();
  } catch (const Failure&) {
    throw;
  } catch (const std::exception& thrown) {
    throw Failure(ExitCode::protective_stop, "{} threw: {}", whose, thrown.what());
  } catch (...) {
    throw Failure(ExitCode::protective_stop, "{} threw an exception that is no std::exception",
                  whose);
  }
}

}  // namespace tachless::base
