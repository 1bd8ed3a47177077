// One UDP socket in one multicast group. What it hears is chosen by the kernel, before it takes room in the socket's
// buffer, see socket_filter.h.
#pragma once

#include <netinet/in.h>

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "lcmtypes/bus/bus_url.h"
#include "lcmtypes/bus/lcm_wire.h"
#include "lcmtypes/bus/socket_filter.h"

namespace swarm {

struct Datagram {
  std::uint64_t sender = 0;  // address and port
  std::span<const std::uint8_t> bytes;
};

// Not copyable; used by one thread.
class MulticastSocket {
 public:
  // Throws std::runtime_error with what the computer lacks, and which command mends it.
  explicit MulticastSocket(const UdpmUrl& url);
  ~MulticastSocket();
  MulticastSocket(const MulticastSocket&) = delete;
  MulticastSocket& operator=(const MulticastSocket&) = delete;

  // What the kernel grants [bytes].
  int receive_buffer() const { return receive_buffer_; }
  // Whether multicast has a way of its own. A local bus does without, LCM's own programs do not.
  bool is_routed() const;

  // Joins on what interfaces there are now, since they come and go: the one that leads to the group, of a local bus all
  // others too. A local bus always has the loopback interface, so it outlives every other.
  void join();

  // From now on of whole messages those on these channels only; others may come all the same, where the kernel takes no
  // filter of so many.
  void hear_only(std::span<const std::string> channels);

  // The next datagram, if one is pending; its bytes are good until the next call.
  std::optional<Datagram> receive();

  // Where the route leads; on a local bus over loopback where there is none. False when it could not be sent.
  bool send(std::span<const std::uint8_t> head, std::span<const std::uint8_t> payload);

  // Readable while datagrams are pending.
  int fd() const { return fd_; }

 private:
  void join_on(unsigned interface);

  int fd_ = -1;
  SocketFilter filter_;
  sockaddr_in group_{};
  int receive_buffer_ = 0;
  std::array<std::uint8_t, kMaxDatagram> buffer_{};
};

}  // namespace swarm
