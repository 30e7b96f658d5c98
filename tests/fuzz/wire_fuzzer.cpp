// Decodes hostile payloads with every codec. There is no crash and no unreasonable allocation. An
// accepted payload encodes to the same content again.
// Input: one byte selects type and layout, the rest is the payload.

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <tuple>
#include <utility>

#include "messages/truth/truth_wire.h"
#include "messages/wire.h"
#include "tests/fuzz/message_list.h"

using namespace tachless;

namespace {

using messages::all_finite;

template <class Value>
struct Subject {
  explicit Subject(const messages::Layout& layout) : codec(layout), second(layout) {}
  messages::Codec<Value> codec;
  messages::Codec<Value> second;
  Value value{};

  void decode(std::span<const std::byte> payload) {
    messages::Stamp stamp;
    if (codec.decode(payload, stamp, value) != messages::Rejection::none) return;
    if (!all_finite(value)) std::abort();
    const auto again = second.encode(stamp, value);
    Value copy{};
    messages::Stamp stamp_again;
    if (codec.decode(again, stamp_again, copy) != messages::Rejection::none ||
        stamp_again.run != stamp.run || stamp_again.tick != stamp.tick ||
        stamp_again.utime != stamp.utime || again.size() != payload.size()) {
      std::abort();
    }
  }
};

template <class... Value>
std::tuple<Subject<Value>...> subjects_of(messages::TypeList<Value...>);
using Subjects = decltype(subjects_of(fuzz::Messages()));
constexpr std::size_t num_subjects = std::tuple_size_v<Subjects>;

template <std::size_t... I>
Subjects make(const messages::Layout& layout, std::index_sequence<I...>) {
  return Subjects(std::tuple_element_t<I, Subjects>(layout)...);
}

template <std::size_t... I>
void decode(Subjects& subjects, std::size_t which, std::span<const std::byte> payload,
            std::index_sequence<I...>) {
  ((which == I ? std::get<I>(subjects).decode(payload) : void()), ...);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr auto indices = std::make_index_sequence<num_subjects>();
  static Subjects rigid = make({.num_joints = 2, .num_motors = 0, .num_signals = 2}, indices);
  static Subjects flexible = make({.num_joints = 3, .num_motors = 3, .num_signals = 4}, indices);
  if (size == 0) return 0;
  decode(data[0] >= 128 ? flexible : rigid, data[0] % num_subjects,
         std::as_bytes(std::span(data + 1, size - 1)), indices);
  return 0;
}
