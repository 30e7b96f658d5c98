#pragma once

#include <cstddef>

/// Returns how often this thread has called the global allocator. The program has to link
/// counting_new.cpp, which replaces the allocator.
extern thread_local std::size_t allocations;
