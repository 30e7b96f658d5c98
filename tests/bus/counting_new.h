#pragma once

#include <cstddef>

/// How often the global allocator was called. Counted in programs that link counting_new.cpp,
/// which replaces it.
extern std::size_t allocations;
