// The radio between the robots of one computer: each has a swarm port of its own, and what one sends reaches the others
// as the link model says. So no root is needed for delays and losses between real processes.
#pragma once

#include <functional>
#include <memory>
#include <queue>
#include <string>
#include <vector>

#include "lcmtypes/bus/node.h"
#include "swarm_sim/hosts/link_model.h"

namespace swarm {

class Relay {
 public:
  // `world_time` [s] says when outages are.
  Relay(const LinkOptions& options, std::uint64_t seed, std::function<double(Utime utime)> world_time);
  ~Relay();

  // What sits on the swarm bus of one robot. Lives as long as the relay.
  Node& add_robot(int id);

 private:
  class Port;
  struct Datagram {
    Utime due;
    std::int64_t number;
    std::string channel;
    std::shared_ptr<const std::vector<std::uint8_t>> bytes;
    bool operator>(const Datagram& other) const { return std::pair(due, number) > std::pair(other.due, other.number); }
  };
  // To everybody else.
  void send(Utime now, int from_id, std::string_view channel, std::span<const std::uint8_t> bytes);

  LinkModel link_;
  std::function<double(Utime)> world_time_;
  std::vector<std::unique_ptr<Port>> ports_;
  std::int64_t next_number_ = 0;
};

}  // namespace swarm
