#pragma once

/// Defines __SANITIZE_ADDRESS__ and __SANITIZE_THREAD__ if clang builds with that sanitizer; g++
/// defines them itself.
#ifdef __has_feature
#if __has_feature(address_sanitizer)
#define __SANITIZE_ADDRESS__ 1
#endif
#if __has_feature(thread_sanitizer)
#define __SANITIZE_THREAD__ 1
#endif
#endif
