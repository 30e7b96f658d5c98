#include "controller/spec.h"

#include <fmt/format.h>

#include <algorithm>

#include "base/text.h"
#include "messages/measurements.h"

namespace tachless::controller {

std::string Spec::law_text() const {
  return announced.empty() ? law : fmt::format("{} ({})", announced, law);
}

std::optional<base::Refusal> Spec::refusal() const {
  if (!base::consists_of(law, "_", false)) {
    return base::Refusal{"law",
                         fmt::format("\"{}\"; allowed: lower-case letters, digits and _", law)};
  }
  if (law == external_law_name && std::ranges::find(messages::measurement_suffixes, measurement) ==
                                      messages::measurement_suffixes.end()) {
    return base::Refusal{
        "measurement",
        fmt::format("{}; needed with law: {}: {}",
                    measurement.empty() ? "missing" : '"' + measurement + '"', external_law_name,
                    base::joined(messages::measurement_suffixes))};
  }
  for (const auto& [gain, value] : gains) {
    if (base::consists_of(gain, "_")) continue;
    return base::Refusal{"gains." + gain, "not a gain's name; allowed: letters, digits and _"};
  }
  return std::nullopt;
}

}  // namespace tachless::controller
