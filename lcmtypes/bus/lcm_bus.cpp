#include "lcmtypes/bus/lcm_bus.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <lcm/lcm-cpp.hpp>
#include <set>
#include <stdexcept>
#include <utility>

namespace swarm {
namespace {

constexpr std::string_view kScheme = "udpm://";
constexpr int kQueueCapacity = 256;  // per channel; LCM drops the newest beyond it, and a step may take a while
constexpr int kPortion = 1024;       // messages per drain()

[[noreturn]] void refuse(const std::string& url, const std::string& rule) {
  throw std::invalid_argument("bus '" + url + "': " + rule);
}

int parse_int(const std::string& url, const std::string& name, std::string_view text, int low, int high) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || value < low || value > high) {
    refuse(url, name + " must be a whole number within [" + std::to_string(low) + ", " + std::to_string(high) + "]");
  }
  return value;
}

// Cuts `*text` at the first `separator` and returns what stood before it (all of it when there is none).
std::string_view cut(std::string_view* text, char separator) {
  const std::size_t at = std::min(text->find(separator), text->size());
  const std::string_view head = text->substr(0, at);
  text->remove_prefix(std::min(at + 1, text->size()));
  return head;
}

// Tries on a plain socket what LCM will do, since LCM reports the reasons badly or not at all. Returns the receive
// buffer that the kernel grants [bytes].
int probe(const UdpmUrl& url) {
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) throw std::runtime_error(std::string("no UDP socket: ") + std::strerror(errno));
  const std::unique_ptr<const int, void (*)(const int*)> closer(&fd, [](const int* open) { ::close(*open); });

  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(url.port));
  ip_mreq membership{};
  ::inet_pton(AF_INET, url.group.c_str(), &address.sin_addr);
  membership.imr_multiaddr = address.sin_addr;
  if (::setsockopt(fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof(membership)) != 0 ||
      ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    const std::string reason = std::strerror(errno);
    throw std::runtime_error("bus " + url.to_string() + ": no route for multicast (" + reason +
                             "); mend with: ip route add 224.0.0.0/4 dev lo" +
                             (url.ttl > 0 ? "  (instead of lo the device that reaches the other robots)" : ""));
  }
  int granted = 0;
  socklen_t size = sizeof(granted);
  ::setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &url.recv_buf_size, sizeof(url.recv_buf_size));
  ::getsockopt(fd, SOL_SOCKET, SO_RCVBUF, &granted, &size);
  return granted / 2;  // the kernel reports twice what it grants
}

}  // namespace

UdpmUrl UdpmUrl::parse(const std::string& url) {
  if (!url.starts_with(kScheme)) refuse(url, "must be udpm://ADDRESS:PORT?ttl=N");
  std::string_view parameters = std::string_view(url).substr(kScheme.size());
  std::string_view port = cut(&parameters, '?');
  UdpmUrl parsed;
  parsed.group = cut(&port, ':');
  in_addr address{};
  if (::inet_pton(AF_INET, parsed.group.c_str(), &address) != 1 || !IN_MULTICAST(ntohl(address.s_addr))) {
    refuse(url, "the address must be within 224.0.0.0 to 239.255.255.255");
  }
  parsed.port = parse_int(url, "the port", port, 1, 65535);
  std::set<std::string_view> seen;
  while (!parameters.empty()) {
    std::string_view value = cut(&parameters, '&');
    const std::string_view name = cut(&value, '=');
    if (!seen.insert(name).second) refuse(url, "parameter '" + std::string(name) + "' is given twice");
    if (name == "ttl") {
      parsed.ttl = parse_int(url, "ttl", value, 0, 255);
    } else if (name == "recv_buf_size") {
      parsed.recv_buf_size = parse_int(url, "recv_buf_size", value, 4096, 1 << 30);
    } else {
      refuse(url, "unknown parameter '" + std::string(name) + "' (there are ttl and recv_buf_size)");
    }
  }
  return parsed;
}

std::string UdpmUrl::to_string() const {
  return std::string(kScheme) + group + ":" + std::to_string(port) + "?ttl=" + std::to_string(ttl) +
         "&recv_buf_size=" + std::to_string(recv_buf_size);
}

LcmBus::LcmBus(const std::string& url) : url_(UdpmUrl::parse(url)) {
  if (const int granted = probe(url_); granted < url_.recv_buf_size) {
    const std::string asked = std::to_string(url_.recv_buf_size);
    warnings_.push_back("bus " + url_.to_string() + ": receive buffer of " + std::to_string(granted) +
                        " bytes instead of " + asked +
                        ", large messages may be lost; mend with: sysctl -w net.core.rmem_max=" + asked);
    url_.recv_buf_size = granted;  // else LCM complains once more, over several lines
  }
  lcm_ = std::make_unique<lcm::LCM>(url_.to_string());
  fd_ = lcm_->good() ? lcm_->getFileno() : -1;  // starts LCM's receiver, which tests itself
  if (fd_ < 0) {
    throw std::runtime_error("bus " + url_.to_string() +
                             ": LCM hears nothing of what it sends; does a firewall block UDP port " +
                             std::to_string(url_.port) + "?");
  }
}

LcmBus::~LcmBus() = default;

void LcmBus::subscribe(const std::string& channel, Handler handler) {
  const auto plain = [](unsigned char c) { return std::isalnum(c) != 0 || c == '_'; };
  if (channel.empty() || channel.size() > LCM_MAX_CHANNEL_NAME_LENGTH ||
      !std::all_of(channel.begin(), channel.end(), plain)) {
    throw std::invalid_argument("channel '" + channel + "': must be 1 to " +
                                std::to_string(LCM_MAX_CHANNEL_NAME_LENGTH) + " letters, digits or '_'");
  }
  subscriptions_.push_back(std::make_unique<Subscription>(Subscription{this, std::move(handler)}));
  constexpr auto receive = [](const lcm_recv_buf_t* buffer, const char* name, void* context) {
    const auto* const subscription = static_cast<const Subscription*>(context);
    try {
      subscription->handler(name, {static_cast<const std::uint8_t*>(buffer->data), buffer->data_size});
    } catch (...) {  // must not unwind through LCM, which would be left locked
      subscription->bus->thrown_ = std::current_exception();
    }
  };
  lcm_subscription_t* const subscription =
      lcm_subscribe(lcm_->getUnderlyingLCM(), channel.c_str(), receive, subscriptions_.back().get());
  if (subscription == nullptr) throw std::runtime_error("channel '" + channel + "': LCM refuses the subscription");
  lcm_subscription_set_queue_capacity(subscription, kQueueCapacity);
}

bool LcmBus::publish(std::string_view channel, std::span<const std::uint8_t> bytes) {
  return lcm_->publish(std::string(channel), bytes.data(), static_cast<unsigned>(bytes.size())) == 0;
}

int LcmBus::drain() {
  int handled = 0;
  while (handled < kPortion && !thrown_ && lcm_->handleTimeout(0) > 0) ++handled;
  if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
  return handled;
}

}  // namespace swarm
