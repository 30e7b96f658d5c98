#pragma once

#include <cstddef>

/// How often this thread called the global allocator. Counted in programs that link
/// counting_new.cpp, which replaces it.
extern thread_local std::size_t allocations;
