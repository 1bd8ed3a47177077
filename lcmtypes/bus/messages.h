// The message types, and what message_list.h says of each.
#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <string_view>
#include <tuple>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/limits.h"
#include "sogm_swarm/all.hpp"

namespace swarm {

// The variable array of a message: its count (the field right before it), its elements, their size and highest number.
template <class Count, class Elements>
struct MessageArray {
  Count count;
  Elements elements;
  std::size_t element_bytes, max_count;
};
struct NoArray {};

constexpr NoArray message_array() {
  return {};
}
template <class Count, class Elements>
constexpr auto message_array(Count count, Elements elements, std::size_t element_bytes, std::size_t max_count) {
  return MessageArray<Count, Elements>{count, elements, element_bytes, max_count};
}

// Of a message type: kChannels, and kArray, a MessageArray or NoArray.
template <class T>
struct MessageTraits;

#define SWARM_ON(constant, text, bus) Channel{text, BusId::bus},
#define SWARM_ARRAY(count, elements, bytes, most) &Type::count, &Type::elements, bytes, most
#define SWARM_TRAITS(type, channels, ...)                      \
  template <>                                                  \
  struct MessageTraits<sogm_swarm::type> {                     \
    using Type = sogm_swarm::type;                             \
    static constexpr Channel kChannels[] = {channels};         \
    static constexpr auto kArray = message_array(__VA_ARGS__); \
  };
SWARM_MESSAGES(SWARM_TRAITS)
#undef SWARM_TRAITS
#undef SWARM_ARRAY
#undef SWARM_ON

// Whether messages of type T are what the channel of this name carries; the channels of cells are of one kind.
template <class T>
bool is_carried_by(std::string_view channel) {
  const std::string_view kind = kind_of(channel);
  return std::ranges::any_of(MessageTraits<T>::kChannels, [=](const Channel& own) { return kind == own.name; });
}

template <class Nothing, class... T>
struct MessageTuple {
  using Type = std::tuple<T...>;
};
#define SWARM_AND_TYPE(type, ...) , sogm_swarm::type
// std::tuple of all message types.
using AllMessages = MessageTuple<void SWARM_MESSAGES(SWARM_AND_TYPE)>::Type;
#undef SWARM_AND_TYPE

}  // namespace swarm
