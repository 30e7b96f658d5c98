#pragma once

#include <string>
#include <vector>

#include "tests/support/program.h"

/// Plays the four programs on a scenario, to the end; each leaves its counters in
/// `directory`/ROLE, as JSON. `options`: for all four.
/// @throw std::runtime_error with what one wrote that failed
void play(const std::string& scenario, const std::vector<std::string>& options,
          const TemporaryDirectory& directory);

/// Ticks per second of the run that was played there.
double ticks_per_s(const TemporaryDirectory& directory);

double median(std::vector<double> values);
