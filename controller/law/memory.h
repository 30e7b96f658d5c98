#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <string_view>
#include <tuple>
#include <type_traits>

#include "robot/quantities.h"

/// What a law carries from one step to the next, open to whoever has to read and write it number by
/// number (certificate/ linearises laws). A memory that is not empty declares its members:
///
///   struct Memory {
///     robot::Vector nu, e_previous;
///     static constexpr std::tuple members{&Memory::nu, &Memory::e_previous};
///   };
///
/// each a vector, such a memory, or an array of one of them; or, where the step has no useful
/// derivative by its memory, why: `static constexpr std::string_view no_linearisation = "…";`.
namespace tachless::controller::law {

namespace detail {

template <class T>
inline constexpr bool made_of_vectors = std::is_empty_v<T>;
template <>
inline constexpr bool made_of_vectors<robot::Vector> = true;
template <class T, std::size_t n>
inline constexpr bool made_of_vectors<std::array<T, n>> = made_of_vectors<T>;
template <class T>
requires requires { T::members; }
inline constexpr bool made_of_vectors<T> = std::apply(
    []<class... Member>(Member T::*... /*member*/) {
      return (made_of_vectors<Member> && ...) &&
             (sizeof(Member) + ...) == sizeof(T);  // none is forgotten
    },
    T::members);

template <class T>
inline constexpr bool is_array = false;
template <class T, std::size_t n>
inline constexpr bool is_array<std::array<T, n>> = true;

}  // namespace detail

/// All numbers of the memory are in vectors that `for_each_vector` finds.
template <class Memory>
concept MadeOfVectors = detail::made_of_vectors<Memory>;

template <class Memory>
concept DeclaredMemory = MadeOfVectors<Memory>
!= requires {
  { Memory::no_linearisation } -> std::convertible_to<std::string_view>;
};

/// f(vector) for each vector of a memory, always in the same order. Which of them are empty is the
/// law's business.
template <class Memory, class F>
requires MadeOfVectors<std::remove_const_t<Memory>>
void for_each_vector(Memory& memory, const F& f) {
  using Plain = std::remove_const_t<Memory>;
  if constexpr (std::same_as<Plain, robot::Vector>) {
    f(memory);
  } else if constexpr (detail::is_array<Plain>) {
    for (auto& each : memory) for_each_vector(each, f);
  } else if constexpr (!std::is_empty_v<Plain>) {
    std::apply([&](auto... member) { (for_each_vector(memory.*member, f), ...); }, Plain::members);
  }
}

}  // namespace tachless::controller::law
