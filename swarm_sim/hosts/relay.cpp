#include "swarm_sim/hosts/relay.h"

#include "lcmtypes/bus/channels.h"

namespace swarm {
namespace {

constexpr std::int64_t kPeriod_us = 2'000;  // so late, at most, datagrams are
constexpr std::size_t kMost = 10'000;       // datagrams under way to one robot; more are lost

}  // namespace

class Relay::Port : public Node {
 public:
  Port(Relay& relay, int id) : relay_(relay), id_(id) {}

  std::vector<Subscription> subscriptions() const override { return {{BusId::kSwarm, channel::kTrajectory}}; }

  void on_message(std::int64_t now_us, BusId, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox&) override {
    sogm_swarm::announcement_t message;  // what the others sent comes back as well
    if (decode(bytes, &message) != Refusal::kNone || message.header.robot_id != id_) return;
    relay_.send(now_us, id_, channel, bytes);
  }

  std::int64_t step(std::int64_t now_us, Outbox& outbox) override {
    for (; !queue_.empty() && queue_.top().due_us <= now_us; queue_.pop())
      outbox.publish_bytes(BusId::kSwarm, queue_.top().channel, *queue_.top().bytes);
    return now_us + kPeriod_us;
  }

  int id() const { return id_; }
  void receive(Datagram datagram) {
    if (queue_.size() < kMost) queue_.push(std::move(datagram));
  }

 private:
  Relay& relay_;
  int id_;
  std::priority_queue<Datagram, std::vector<Datagram>, std::greater<>> queue_;
};

Relay::Relay(const LinkOptions& options, std::uint64_t seed, std::function<double(std::int64_t utime)> world_time)
    : link_(options, seed), world_time_(std::move(world_time)) {}
Relay::~Relay() = default;

Node& Relay::add_robot(int id) {
  return *ports_.emplace_back(std::make_unique<Port>(*this, id));
}

void Relay::send(std::int64_t now_us, int from_id, std::string_view channel, std::span<const std::uint8_t> bytes) {
  const auto shared = std::make_shared<const std::vector<std::uint8_t>>(bytes.begin(), bytes.end());
  for (const auto& port : ports_) {
    if (port->id() == from_id) continue;
    for (const std::int64_t later_us : link_.deliveries(from_id, port->id(), world_time_(now_us)))
      port->receive({now_us + later_us, next_number_++, std::string(channel), shared});
  }
}

}  // namespace swarm
