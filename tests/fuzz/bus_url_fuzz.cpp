// Bus URLs: what is accepted is within its ranges and reads back as the same from its own text.
#include <stdexcept>

#include "lcmtypes/bus/bus_url.h"
#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {

void try_input(FuzzInput input) {
  UdpmUrl url;
  try {
    url = UdpmUrl::parse(std::string(text_of(input.rest())));
  } catch (const std::invalid_argument&) {
    return;
  }
  expect(url.port >= 1 && url.port <= 65535 && url.ttl >= 0 && url.ttl <= 255, "port and TTL are within their ranges");
  expect(url.recv_buf_size >= 4096 && url.recv_buf_size <= 1 << 30, "so is the buffer");
  const UdpmUrl again = UdpmUrl::parse(url.to_string());
  expect(again.group == url.group && again.port == url.port && again.ttl == url.ttl &&
             again.recv_buf_size == url.recv_buf_size,
         "it reads back");
}

}  // namespace swarm::fuzz
