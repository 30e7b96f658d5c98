#include "controller/law/law.h"

#include <gtest/gtest.h>

#include <utility>
#include <vector>

namespace tachless::controller::law::law_test {
namespace {

struct Observer {
  Vector position;
  std::array<Filter::Memory, 2> filter;
  static constexpr std::tuple members{&Observer::position, &Observer::filter};
};
static_assert(MadeOfVectors<Observer> && DeclaredMemory<Observer>);

struct Empty {};
static_assert(DeclaredMemory<Empty>);

struct Undeclared {
  Vector nu;
};
static_assert(!DeclaredMemory<Undeclared>);

struct OneForgotten {
  Vector nu, forgotten;
  static constexpr std::tuple members{&OneForgotten::nu};
};
static_assert(!DeclaredMemory<OneForgotten>);

struct Counter {
  Vector nu;
  int count = 0;
  static constexpr std::tuple members{&Counter::nu, &Counter::count};
};
static_assert(!DeclaredMemory<Counter>);

struct Sums {
  Vector nu;
  std::array<double, 2> sums{};
  static constexpr std::tuple members{&Sums::nu, &Sums::sums};
};
static_assert(sizeof(Sums) == sizeof(Vector) + sizeof(Sums::sums));  // no padding
static_assert(!DeclaredMemory<Sums>);

struct Told {
  int count = 0;
  static constexpr std::string_view no_linearisation = "it counts";
};
static_assert(DeclaredMemory<Told> && !MadeOfVectors<Told>);

TEST(Memory, ShowsEveryVectorInItsOrder) {
  Observer memory;
  std::vector<const Vector*> seen;
  for_each_vector(std::as_const(memory), [&](const Vector& x) { seen.push_back(&x); });
  const std::vector<const Vector*> expected = {&memory.position, &memory.filter[0].nu,
                                               &memory.filter[0].e_previous, &memory.filter[1].nu,
                                               &memory.filter[1].e_previous};
  EXPECT_EQ(seen, expected);
  for_each_vector(memory, [](Vector& x) { x = Vector::Ones(2); });
  EXPECT_EQ(memory.filter[1].e_previous.sum(), 2);
  Empty empty;
  for_each_vector(empty, [](const Vector& /*x*/) { ADD_FAILURE() << "a vector of nothing"; });
}

}  // namespace
}  // namespace tachless::controller::law::law_test
