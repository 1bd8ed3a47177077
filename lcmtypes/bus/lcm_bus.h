// One LCM bus: bytes in and out of UDP multicast. What the bytes mean is for the nodes, see codec.h.
#pragma once

#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace lcm {
class LCM;
}

namespace swarm {

// A checked udpm://ADDRESS:PORT?ttl=N&recv_buf_size=N. Buses must differ by port: LCM hears all groups of its port.
struct UdpmUrl {
  std::string group;              // multicast address, 224.0.0.0 to 239.255.255.255
  int port = 0;                   // [1, 65535]
  int ttl = 0;                    // [0, 255]; 0 never leaves the computer, 1 stays in the local network
  int recv_buf_size = 2'097'152;  // asked of the kernel [bytes], [4096, 2^30]: all fragments of a message must fit

  // Throws std::invalid_argument with the URL and what is wrong with it.
  static UdpmUrl parse(const std::string& url);
  std::string to_string() const;  // names every parameter
};

// Not copyable; used by one thread.
class LcmBus {
 public:
  using Handler = std::function<void(std::string_view channel, std::span<const std::uint8_t> bytes)>;

  // Throws std::invalid_argument for a malformed URL and std::runtime_error with the mending command when the computer
  // has no route for multicast or LCM cannot be started.
  explicit LcmBus(const std::string& url);
  ~LcmBus();

  // What is in force.
  const UdpmUrl& url() const { return url_; }
  // One line each: what works worse than asked for, and which command mends it.
  const std::vector<std::string>& warnings() const { return warnings_; }

  // Calls `handler` from drain() for each message of exactly this channel, the own ones included, whatever its bytes.
  // Letters, digits and '_' only (std::invalid_argument), for LCM takes channels as regular expressions.
  void subscribe(const std::string& channel, Handler handler);

  // False when the message could not be sent.
  [[nodiscard]] bool publish(std::string_view channel, std::span<const std::uint8_t> bytes);

  // Handles what is pending, without waiting, and returns the number of messages; a flood is handled in portions, so
  // that the caller gets its turn. What a handler throws leaves drain() after LCM has been left in order.
  int drain();

  // Readable while messages are pending.
  int fd() const { return fd_; }

 private:
  struct Subscription {
    LcmBus* bus;
    Handler handler;
  };

  UdpmUrl url_;
  std::vector<std::string> warnings_;
  std::unique_ptr<lcm::LCM> lcm_;
  int fd_ = -1;
  std::vector<std::unique_ptr<Subscription>> subscriptions_;  // LCM holds their addresses
  std::exception_ptr thrown_;                                 // by a handler during drain()
};

}  // namespace swarm
