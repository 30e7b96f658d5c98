#pragma once

#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include "bus/message_shape.h"
#include "bus/wire.h"

/// The members of `Codec`, for the two files that instantiate it (wire.cpp, truth/truth_wire.cpp).
/// Nobody else includes this.
namespace tachless::bus {

/// How a value becomes a generated message and back; specialised beside each instantiation:
///   using Message = …;
///   static MessageShape shape(const Layout&);
///   static void size(const Layout&, Message&);               // makes room for the arrays, once
///   static void write(const Value&, const Layout&, Message&);  // throws std::logic_error
///   static Rejection check(const Message&);                  // ranges of single fields
///   static void read(const Message&, Value&);
template <class Value>
struct Translation;

template <class Value>
struct Codec<Value>::Scratch {
  loop::Layout layout;
  MessageShape shape;
  typename Translation<Value>::Message message;
  std::vector<std::byte> bytes;
};

inline void require_joints(const loop::Layout& layout) {
  const bool motors_ok = layout.num_motors == 0 || layout.num_motors == layout.num_joints;
  const bool signals_ok = layout.num_signals >= 0 && layout.num_signals <= loop::max_signals;
  if (layout.num_joints < 1 || layout.num_joints > robot::max_joints || !motors_ok || !signals_ok) {
    throw std::logic_error("bus::Codec: impossible layout: num_joints " +
                           std::to_string(layout.num_joints) + ", num_motors " +
                           std::to_string(layout.num_motors) + ", num_signals " +
                           std::to_string(layout.num_signals));
  }
}

inline void put(const robot::Vector& from, int expected, const char* what,
                std::vector<double>& to) {
  if (from.size() != expected) {
    throw std::logic_error(std::string("bus::Codec: ") + what + " has " +
                           std::to_string(from.size()) + " entries, the layout says " +
                           std::to_string(expected));
  }
  std::copy(from.begin(), from.end(), to.begin());
}

inline void get(const std::vector<double>& from, robot::Vector& to) {
  to.resize(static_cast<Eigen::Index>(from.size()));  // in place: robot::Vector never allocates
  std::copy(from.begin(), from.end(), to.begin());
}

template <class Value>
Codec<Value>::Codec(const loop::Layout& layout)
    : scratch_(new Scratch{layout, Translation<Value>::shape(layout), {}, {}}) {
  Translation<Value>::size(layout, scratch_->message);
  scratch_->bytes.resize(scratch_->shape.max_size());
}

template <class Value>
Codec<Value>::~Codec() = default;
template <class Value>
Codec<Value>::Codec(Codec&&) noexcept = default;
template <class Value>
Codec<Value>& Codec<Value>::operator=(Codec&&) noexcept = default;

template <class Value>
std::span<const std::byte> Codec<Value>::encode(const loop::Stamp& stamp, const Value& value) {
  auto& [layout, shape, message, bytes] = *scratch_;
  if (!all_finite(value)) {
    throw std::domain_error("bus::Codec: NaN or infinity in a message for channel …_" +
                            std::string(loop::ChannelOf<Value>::suffix));
  }
  Translation<Value>::write(value, layout, message);
  message.utime = stamp.utime;
  message.run = stamp.run;
  message.tick = stamp.tick;
  const auto size = static_cast<std::size_t>(message.getEncodedSize());
  if (size > bytes.size()) {
    throw std::length_error(
        "bus::Codec: message for channel …_" + std::string(loop::ChannelOf<Value>::suffix) +
        " has " + std::to_string(size) + " bytes, allowed are " + std::to_string(bytes.size()));
  }
  if (message.encode(bytes.data(), 0, static_cast<int>(size)) != static_cast<int>(size)) {
    throw std::logic_error("bus::Codec: the generated encoder failed");
  }
  return {bytes.data(), size};
}

template <class Value>
std::size_t Codec<Value>::longest() const {
  return scratch_->shape.max_size();
}

template <class Value>
Rejection Codec<Value>::decode(std::span<const std::byte> payload, loop::Stamp& stamp,
                               Value& value) const {
  const Rejection rejection = scratch_->shape.check(payload);
  if (rejection != Rejection::none) return rejection;
  auto& message = scratch_->message;
  const int size = static_cast<int>(payload.size());
  if (message.decode(payload.data(), 0, size) != size) {
    throw std::logic_error("bus::Codec: the generated decoder refused a checked message");
  }
  const Rejection range = Translation<Value>::check(message);
  if (range != Rejection::none) return range;
  stamp = {message.utime, message.run, message.tick};
  Translation<Value>::read(message, value);
  return Rejection::none;
}

}  // namespace tachless::bus
