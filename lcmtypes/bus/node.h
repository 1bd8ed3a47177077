// The middle tier of every daemon: a node turns messages and the passing of time into messages. It knows neither LCM
// nor a clock, so the same object runs in real time over multicast and in lock-step inside the simulator.
#pragma once

#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "lcmtypes/bus/activity.h"
#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/time.h"

namespace swarm {

// kNobody: messages are there before the node's next step, whatever that is for. For what comes often and changes
// nothing by itself.
enum class Wakes { kNode, kNobody };

struct Subscription {
  BusId bus;
  std::string channel;  // exact name
  Wakes wakes = Wakes::kNode;
};

// Where a node puts its messages. Implemented by the hosts.
class Outbox {
 public:
  virtual ~Outbox() = default;

  // Encodes and seals (CRC) `message`, then hands it to the host.
  template <class T>
  void publish(BusId bus, std::string_view channel, const T& message) {
    encode(message, &buffer_);
    publish_bytes(bus, channel, buffer_);
  }

  // Sends bytes as they are (relays).
  virtual void publish_bytes(BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes) = 0;

  // From now on the node hears this channel, which is none of its subscriptions(), or no more. For nodes that move from
  // cell to cell; in step() alone. Throws std::logic_error where the host has no such nodes.
  virtual void listen(BusId bus, std::string_view channel, bool listens);

 private:
  std::vector<std::uint8_t> buffer_;
};

inline void Outbox::listen(BusId, std::string_view channel, bool) {
  throw std::logic_error("this host's nodes hear the same channels all the time, not now and then " +
                         std::string(channel));
}

// Single-threaded; never blocks, sleeps or throws in on_message and step.
class Node {
 public:
  virtual ~Node() = default;

  virtual std::vector<Subscription> subscriptions() const = 0;

  // One message of a subscribed channel. `bytes` may be anything at all; it is valid during the call only.
  virtual void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                          Outbox& outbox) = 0;

  // Does what is due at `now`. Called after every batch of messages and at the returned time at the latest.
  // Returns the next time it wants to be called, later than `now`.
  virtual Utime step(Utime now, Outbox& outbox) = 0;

  // The computer's wall clock was stepped: from the next call on, times shall be later by `step` (earlier where it is
  // negative). True: so they will be. False: not now; time goes on as it is, and the node is asked again before
  // every step. 0: the clock is back where it was, and nothing changes.
  virtual bool on_clock_step([[maybe_unused]] Utime now, [[maybe_unused]] Duration step) { return true; }

  // For the log, see activity.h. Asked once a second.
  virtual Activity activity([[maybe_unused]] Utime now) const { return {}; }
};

}  // namespace swarm
