// From bytes to a message that a node may believe: the checks that all nodes make of all messages, in one order.
#pragma once

#include <concepts>
#include <cstdint>
#include <span>
#include <type_traits>
#include <utility>

#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/time.h"

namespace swarm {

// How old messages may be, and how far ahead.
struct TimeWindow {
  Utime now{};
  Duration max_age = kAnyTime, max_ahead = kAnyTime;  // at least 0, at most the defaults: any time will do

  static constexpr Duration kAnyTime = kMaxUtime.time_since_epoch();
};

// Whose messages are taken, for receive(): one robot's.
struct FromRobot {
  int id;
  template <class T>
  Refusal operator()(const T& message) const {
    return message.header.robot_id == id ? Refusal::kNone : Refusal::kRobot;
  }
};

// For receive(): messages that are in order by other rules.
struct AnyOrder {
  template <class T>
  Refusal operator()(const T&) const {
    return Refusal::kNone;
  }
};

// Of a message that is valid: asks `from` (whose it is), checks the time and at last asks `order` (a SequenceGate, or
// whatever takes the message and says so): a message that is refused before uses up no number. `from` and `order` take
// the message and return a Refusal.
template <class T, class From, class Order>
[[nodiscard]] Refusal admit(const T& message, const From& from, const TimeWindow& window, Order&& order) {
  if (const Refusal refusal = from(message); refusal != Refusal::kNone) return refusal;
  const Refusal refusal = check_time(to_utime(message.header.utime), window.now, window.max_age, window.max_ahead);
  if (refusal != Refusal::kNone) return refusal;
  if constexpr (std::same_as<std::remove_cvref_t<Order>, SequenceGate>) {
    return order.pass(message.header);
  } else {
    return order(message);
  }
}

// Decodes, validates and admits. `message` is good after kNone, kTime and what only `from` or `order` return, as kRobot
// and kSequence; after what decode() refuses it is unspecified.
template <class T, class From, class Order>
[[nodiscard]] Refusal receive(std::span<const std::uint8_t> bytes, const From& from, const TimeWindow& window,
                              Order&& order, T* message) {
  if (const Refusal refusal = decode(bytes, message); refusal != Refusal::kNone) return refusal;
  return admit(*message, from, window, std::forward<Order>(order));
}

}  // namespace swarm
