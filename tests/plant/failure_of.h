#pragma once

#include <optional>

#include "base/failure.h"

namespace tachless::plant::testing {

/// Returns the failure of `call`; none if it succeeds.
template <class Call>
std::optional<base::Failure> failure_of(const Call& call) {
  try {
    call();
  } catch (const base::Failure& failure) {
    return failure;
  }
  return {};
}

}  // namespace tachless::plant::testing
