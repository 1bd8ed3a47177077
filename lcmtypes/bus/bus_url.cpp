#include "lcmtypes/bus/bus_url.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <charconv>
#include <set>
#include <stdexcept>
#include <string_view>

namespace swarm {
namespace {

constexpr std::string_view kScheme = "udpm://";

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

}  // namespace

std::string swarm_bus_url(int base_port, int ttl) {
  return "udpm://239.255.76.68:" + std::to_string(base_port) + "?ttl=" + std::to_string(ttl);
}

std::string onboard_bus_url(int base_port, int robot_id) {
  return "udpm://239.255.76.67:" + std::to_string(base_port + 33 + robot_id) + "?ttl=0";
}

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

}  // namespace swarm
