#include "swarm_sim/hosts/relay.h"

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/receive.h"

namespace swarm {
namespace {

constexpr Duration kPeriod = 2ms;      // so late, at most, datagrams are
constexpr std::size_t kMost = 10'000;  // datagrams under way to one robot; more are lost

}  // namespace

class Relay::Port : public Node {
 public:
  Port(Relay& relay, int id) : relay_(relay), id_(id) {}

  std::vector<Subscription> subscriptions() const override {
    return {{BusId::kSwarm, channel::kAnnouncement}, {BusId::kSwarm, channel::kLastWords}};
  }

  void on_message(Utime now, BusId, std::string_view channel, std::span<const std::uint8_t> bytes, Outbox&) override {
    // What the others sent comes back as well.
    const bool is_own = channel == channel::kLastWords ? is_of_robot<sogm_swarm::last_words_t>(bytes)
                                                       : is_of_robot<sogm_swarm::packed_announcement_t>(bytes);
    if (is_own) relay_.send(now, id_, channel, bytes);
  }

  Utime step(Utime now, Outbox& outbox) override {
    for (; !queue_.empty() && queue_.top().due <= now; queue_.pop())
      outbox.publish_bytes(BusId::kSwarm, queue_.top().channel, *queue_.top().bytes);
    return now + kPeriod;
  }

  int id() const { return id_; }
  void enqueue(Datagram datagram) {
    if (queue_.size() < kMost) queue_.push(std::move(datagram));
  }

 private:
  template <class T>
  bool is_of_robot(std::span<const std::uint8_t> bytes) const {
    T message;
    return receive(bytes, FromRobot{id_}, {}, AnyOrder{}, &message) == Refusal::kNone;
  }

  Relay& relay_;
  int id_;
  std::priority_queue<Datagram, std::vector<Datagram>, std::greater<>> queue_;
};

Relay::Relay(const LinkOptions& options, std::uint64_t seed, std::function<double(Utime utime)> world_time)
    : link_(options, seed), world_time_(std::move(world_time)) {}
Relay::~Relay() = default;

Node& Relay::add_robot(int id) {
  return *ports_.emplace_back(std::make_unique<Port>(*this, id));
}

void Relay::send(Utime now, int from_id, std::string_view channel, std::span<const std::uint8_t> bytes) {
  const auto shared = std::make_shared<const std::vector<std::uint8_t>>(bytes.begin(), bytes.end());
  for (const auto& port : ports_) {
    if (port->id() == from_id) continue;
    for (const Duration later : link_.deliveries(from_id, port->id(), world_time_(now)))
      port->enqueue({now + later, next_number_++, std::string(channel), shared});
  }
}

}  // namespace swarm
