// What the kernel lets into the socket of a bus, so that nobody is woken for what is not for him.
#pragma once

#include <span>
#include <string>

namespace swarm {

struct SocketFilter {
  // Of a bus of one computer: nothing that came over a network, whatever sender it claims. Of others: no fragments.
  bool is_local = false;
  unsigned loopback = 0;  // interface

  // Both take the place of what was attached before; false, and all is as it was, when the kernel does not take it.
  // Whatever is said on the bus.
  bool attach_to(int fd) const;
  // Whole messages on these channels only, and on a local bus fragments: of those only the first says its channel.
  bool attach_to(int fd, std::span<const std::string> channels) const;
};

}  // namespace swarm
