#include "lcmtypes/bus/multicast_socket.h"

#include <arpa/inet.h>
#include <net/if.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <string>

namespace swarm {
namespace {

[[noreturn]] void fail(const UdpmUrl& url, const std::string& what) {
  throw std::runtime_error("bus " + url.to_string() + ": " + what + " (" + std::strerror(errno) + ")");
}

template <class T>
bool set(int fd, int level, int option, const T& value) {
  return ::setsockopt(fd, level, option, &value, sizeof(value)) == 0;
}

}  // namespace

MulticastSocket::MulticastSocket(const UdpmUrl& url) : filter_{url.is_local(), ::if_nametoindex("lo")} {
  group_.sin_family = AF_INET;
  group_.sin_port = htons(static_cast<std::uint16_t>(url.port));
  ::inet_pton(AF_INET, url.group.c_str(), &group_.sin_addr);
  fd_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd_ < 0) fail(url, "no UDP socket");
  std::unique_ptr<const int, void (*)(const int*)> closer(&fd_, [](const int* open) { ::close(*open); });
  // The filter comes before the first datagram can. Others may listen to the port too: LCM's programs, more daemons.
  if (!filter_.attach_to(fd_)) fail(url, "the kernel takes no socket filter");
  set(fd_, SOL_SOCKET, SO_REUSEADDR, 1);
  set(fd_, SOL_SOCKET, SO_RCVBUF, url.recv_buf_size);
  socklen_t size = sizeof(receive_buffer_);
  ::getsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receive_buffer_, &size);
  receive_buffer_ /= 2;                                             // the kernel reports twice what it grants
  const bool is_set = set(fd_, IPPROTO_IP, IP_MULTICAST_ALL, 0) &&  // no group that others have joined
                      set(fd_, IPPROTO_IP, IP_MULTICAST_TTL, url.ttl) && set(fd_, IPPROTO_IP, IP_MULTICAST_LOOP, 1);
  if (!is_set) fail(url, "the kernel refuses an option of multicast");
  if (::bind(fd_, reinterpret_cast<const sockaddr*>(&group_), sizeof(group_)) != 0) {
    fail(url, "UDP port " + std::to_string(url.port) + " cannot be had");
  }
  if (!filter_.is_local && !is_routed()) {
    fail(url,
         "no route for multicast; mend with: ip route add 224.0.0.0/4 dev DEVICE  (that reaches the other robots)");
  }
  join();
  closer.release();
}

MulticastSocket::~MulticastSocket() {
  ::close(fd_);
}

bool MulticastSocket::is_routed() const {
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return false;
  const int result = ::connect(fd, reinterpret_cast<const sockaddr*>(&group_), sizeof(group_));
  const int reason = errno;
  ::close(fd);
  errno = reason;
  return result == 0;
}

void MulticastSocket::join() {
  if (filter_.is_local) join_on(filter_.loopback);
  join_on(0);
  if (!filter_.is_local) return;
  const std::unique_ptr<struct if_nameindex, void (*)(struct if_nameindex*)> all(::if_nameindex(), ::if_freenameindex);
  for (const auto* one = all.get(); one != nullptr && one->if_index != 0; ++one) join_on(one->if_index);
}

// 0: the one that the route leads over. What cannot be joined, or is joined already, stays as it is.
void MulticastSocket::join_on(unsigned interface) {
  ip_mreqn membership{};
  membership.imr_multiaddr = group_.sin_addr;
  membership.imr_ifindex = static_cast<int>(interface);
  (void)set(fd_, IPPROTO_IP, IP_ADD_MEMBERSHIP, membership);
}

void MulticastSocket::hear_only(std::span<const std::string> channels) {
  if (!filter_.attach_to(fd_, channels)) (void)filter_.attach_to(fd_);
}

std::optional<Datagram> MulticastSocket::receive() {
  sockaddr_in from{};
  socklen_t size = sizeof(from);
  const ssize_t received =
      ::recvfrom(fd_, buffer_.data(), buffer_.size(), 0, reinterpret_cast<sockaddr*>(&from), &size);
  if (received < 0) return std::nullopt;
  const std::uint64_t sender = std::uint64_t{from.sin_addr.s_addr} << 16 | from.sin_port;
  return Datagram{sender, std::span(buffer_).first(static_cast<std::size_t>(received))};
}

bool MulticastSocket::send(std::span<const std::uint8_t> head, std::span<const std::uint8_t> payload) {
  std::array<iovec, 2> parts{};  // sendmsg() only reads them
  parts[0] = {const_cast<std::uint8_t*>(head.data()), head.size()};
  parts[1] = {const_cast<std::uint8_t*>(payload.data()), payload.size()};
  msghdr message{};
  message.msg_name = &group_;
  message.msg_namelen = sizeof(group_);
  message.msg_iov = parts.data();
  message.msg_iovlen = parts.size();
  if (::sendmsg(fd_, &message, MSG_NOSIGNAL) >= 0) return true;
  if (!filter_.is_local || errno == EAGAIN || errno == ENOBUFS) return false;
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(in_pktinfo))> control{};
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  cmsghdr* const option = CMSG_FIRSTHDR(&message);
  option->cmsg_level = IPPROTO_IP;
  option->cmsg_type = IP_PKTINFO;
  option->cmsg_len = CMSG_LEN(sizeof(in_pktinfo));
  in_pktinfo over{};
  over.ipi_ifindex = static_cast<int>(filter_.loopback);
  std::memcpy(CMSG_DATA(option), &over, sizeof(over));
  return ::sendmsg(fd_, &message, MSG_NOSIGNAL) >= 0;
}

}  // namespace swarm
