#include "lcmtypes/bus/socket_filter.h"

#include <linux/filter.h>
#include <sys/socket.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <vector>

#include "lcmtypes/bus/lcm_wire.h"

namespace swarm {
namespace {

constexpr unsigned kLooped = 5;        // PACKET_LOOPBACK of linux/if_packet.h: sent by this computer itself
constexpr std::size_t kUdpHeader = 8;  // bytes; filters count from there
constexpr unsigned kAll = 0xffffffff;  // bytes of a datagram that is let through

// Instructions that run on every datagram before the socket takes it (classic BPF).
class Program {
 public:
  // Of the datagram, or of what the kernel knows about it.
  void load(std::size_t at, unsigned size = BPF_W) {
    instructions_.push_back(BPF_STMT(BPF_LD | BPF_ABS | size, static_cast<unsigned>(at)));
  }
  // Passes over so many instructions when what was loaded is `value`, and over so many when it is not.
  void compare(unsigned value, std::size_t if_equal, std::size_t if_not) {
    instructions_.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, static_cast<std::uint8_t>(if_equal),
                                     static_cast<std::uint8_t>(if_not)));
  }
  void decide(bool is_heard) { instructions_.push_back(BPF_STMT(BPF_RET | BPF_K, is_heard ? kAll : 0)); }

  // Lets whole messages on this channel through. Loads nothing behind the channel's end while it is this channel: a
  // datagram that ends before what is loaded is dropped.
  void hear(const std::string& channel) {
    const std::size_t length = channel.size() + 1;  // with its NUL
    const auto part_at = [&](std::size_t i) { return std::min<std::size_t>(std::bit_floor(length - i), 4); };
    std::size_t parts = 0;
    for (std::size_t i = 0; i < length; i += part_at(i)) ++parts;
    for (std::size_t i = 0, part = 0; i < length; i += part) {
      part = part_at(i);
      unsigned value = 0;
      for (std::size_t k = i; k < i + part; ++k) value = value << 8 | static_cast<unsigned char>(channel.c_str()[k]);
      load(kUdpHeader + kLcmShortHead + i, part == 4 ? BPF_W : part == 2 ? BPF_H : BPF_B);
      compare(value, 0, 2 * --parts + 1);  // not: on to the next channel
    }
    decide(true);
  }

  bool attach_to(int fd) {
    if (instructions_.size() > BPF_MAXINSNS) return false;
    const sock_fprog program{static_cast<std::uint16_t>(instructions_.size()), instructions_.data()};
    return ::setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof(program)) == 0;
  }

 private:
  std::vector<sock_filter> instructions_;
};

// Decides on all but whole messages, which go on to what follows.
Program begun(const SocketFilter& filter) {
  Program program;
  if (filter.is_local) {
    program.load(static_cast<unsigned>(SKF_AD_OFF + SKF_AD_PKTTYPE));
    program.compare(kLooped, 3, 0);
    program.load(static_cast<unsigned>(SKF_AD_OFF + SKF_AD_IFINDEX));
    program.compare(filter.loopback, 1, 0);
    program.decide(false);
  }
  program.load(kUdpHeader);
  program.compare(kLcmShortMagic, 1, 0);
  program.decide(filter.is_local);
  return program;
}

}  // namespace

bool SocketFilter::attach_to(int fd) const {
  Program program = begun(*this);
  program.decide(true);
  return program.attach_to(fd);
}

bool SocketFilter::attach_to(int fd, std::span<const std::string> channels) const {
  std::vector<std::string> shortest_first(channels.begin(), channels.end());  // a datagram may end with its channel
  std::ranges::sort(shortest_first, {}, [](const std::string& channel) { return channel.size(); });
  Program program = begun(*this);
  for (const std::string& channel : shortest_first) program.hear(channel);
  program.decide(false);
  return program.attach_to(fd);
}

}  // namespace swarm
