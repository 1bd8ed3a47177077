// What our channels carry.
#pragma once

#include <optional>
#include <span>
#include <string_view>
#include <type_traits>

#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/packed_announcement.h"

namespace swarm {

// Decodes bytes as what the channel carries and calls use(message) when they are accepted; `use` takes every type of
// message_list.h but packed ones: what is packed is handed on as an announcement_t. Nothing when the channel is not one
// of ours.
template <class Use>
std::optional<Refusal> visit_message(std::string_view name, std::span<const std::uint8_t> bytes, Use&& use) {
  std::optional<Refusal> refusal;
  const auto try_as = [&]<class T>(T message) {
    if (!is_carried_by<T>(name)) return false;
    if constexpr (std::is_same_v<T, sogm_swarm::packed_announcement_t>) {
      sogm_swarm::announcement_t unpacked;
      refusal = decode_packed(bytes, &unpacked);
      if (refusal == Refusal::kNone) use(unpacked);
    } else {
      refusal = decode(bytes, &message);
      if (refusal == Refusal::kNone) use(message);
    }
    return true;
  };
  [&]<class... T>(const std::tuple<T...>*) { (void)(try_as(T{}) || ...); }(static_cast<AllMessages*>(nullptr));
  return refusal;
}

}  // namespace swarm
