// One LCM bus: bytes in and out of UDP multicast, as liblcm's own programs send and hear them. What the bytes mean is
// for the nodes, see codec.h. liblcm itself takes no part: forged fragments crash it, and it hears every network.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "lcmtypes/bus/bus_url.h"
#include "lcmtypes/bus/lcm_wire.h"
#include "lcmtypes/bus/multicast_socket.h"
#include "lcmtypes/bus/seal.h"

namespace swarm {

// Not copyable; used by one thread.
class LcmBus {
 public:
  using Handler = std::function<void(std::string_view channel, std::span<const std::uint8_t> bytes)>;

  // Throws std::invalid_argument for a malformed URL and std::runtime_error with the mending command when the computer
  // has no route for multicast or does not hear what it sends. With `keys` all that is sent is sealed, and what comes
  // without a good seal is as if it had not come; without, seals are taken off unread.
  explicit LcmBus(const std::string& url, SwarmKeys keys = {});

  // What is in force.
  const UdpmUrl& url() const { return url_; }
  // One line each: what works worse than asked for, and which command mends it.
  const std::vector<std::string>& warnings() const { return warnings_; }

  // Calls `handler` from drain() for each message of exactly this channel, the own ones included, whatever its bytes.
  // Letters, digits and '_' only (std::invalid_argument), for LCM's programs take channels as regular expressions.
  void subscribe(const std::string& channel, Handler handler);
  // Not from a handler: nobody is called for this channel any more.
  void unsubscribe(std::string_view channel);

  // False when the message could not be sent.
  [[nodiscard]] bool publish(std::string_view channel, std::span<const std::uint8_t> bytes);

  // Handles what is pending, without waiting, and returns the number of messages of subscribed channels; a flood is
  // handled in portions of 2 ms, so that the caller gets its turn. What a handler throws leaves drain(); the rest stays
  // pending.
  int drain();

  // Messages of subscribed channels without a good seal so far.
  std::int64_t forged() const { return forged_; }

  // Readable while messages are pending.
  int fd() const { return socket_.fd(); }

 private:
  struct Subscription {
    std::string channel;
    Handler handler;
  };

  void test_itself();
  void hear_subscribed();
  void join_again();

  UdpmUrl url_;
  MulticastSocket socket_;
  LcmReader reader_;
  SwarmKeys keys_;
  std::vector<std::uint8_t> sealed_;  // what is sent last
  std::int64_t forged_ = 0;
  std::uint32_t sent_ = 0;  // messages
  std::chrono::steady_clock::time_point joined_;
  std::vector<std::string> warnings_;
  std::vector<Subscription> subscriptions_;
};

}  // namespace swarm
