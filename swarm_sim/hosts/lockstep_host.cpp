#include "swarm_sim/hosts/lockstep_host.h"

#include <array>
#include <limits>
#include <tuple>

namespace swarm {

// A node, its buses and its wake-ups.
class LockstepHost::Place : public Outbox {
 public:
  Place(LockstepHost& host, const Seat& seat, NodeFactory make_node)
      : seat_(seat), host_(host), make_node_(std::move(make_node)) {
    restart();
  }

  const Seat& seat() const { return seat_; }
  Bus& bus(BusId id) const { return host_.buses_.at(id == BusId::kSwarm ? seat_.swarm : seat_.onboard); }
  // Null: it has crashed.
  const Node* node() const { return node_.get(); }

  void crash() { node_.reset(); }
  void restart() {
    node_.reset();
    node_ = make_node_(host_.now_us_);
  }
  void hear(BusId id, std::string_view channel, std::span<const std::uint8_t> bytes) {
    node_->on_message(host_.now_us_ + seat_.clock_offset_us, id, channel, bytes, *this);
  }
  std::int64_t step() { return node_->step(host_.now_us_ + seat_.clock_offset_us, *this) - seat_.clock_offset_us; }
  void publish_bytes(BusId id, std::string_view channel, std::span<const std::uint8_t> bytes) override {
    host_.send(*this, id, channel, bytes);
  }

  std::int64_t wake_us = 0;  // the wake-up in force; earlier entries in the queue are void

 private:
  Seat seat_;
  LockstepHost& host_;
  NodeFactory make_node_;
  std::unique_ptr<Node> node_;
};

bool LockstepHost::Event::operator>(const Event& other) const {
  return std::tie(time_us, order, sequence) > std::tie(other.time_us, other.order, other.sequence);
}

LockstepHost::LockstepHost(std::int64_t now_us) : now_us_(now_us) {}
LockstepHost::~LockstepHost() = default;

void LockstepHost::add_bus(const std::string& name, std::int64_t delay_us, Link link) {
  buses_[name] = {delay_us, std::move(link), {}};
}

std::size_t LockstepHost::add(const Seat& seat, NodeFactory make_node) {
  const std::size_t number = places_.size();
  const Place& place = *places_.emplace_back(std::make_unique<Place>(*this, seat, std::move(make_node)));
  for (const Subscription& subscription : place.node()->subscriptions())
    place.bus(subscription.bus).places[subscription.channel].push_back(number);
  push(now_us_, number, What::kWake);
  return number;
}

void LockstepHost::crash(std::size_t seat, std::int64_t at_us, std::int64_t back_us) {
  push(at_us, seat, What::kCrash);
  push(back_us, seat, What::kRestart);
}

void LockstepHost::run() {
  stopped_ = false;
  while (!events_.empty() && (!stopped_ || events_.top().time_us == now_us_)) {
    const Event event = events_.top();
    events_.pop();
    now_us_ = event.time_us;
    handle(event);
  }
}

void LockstepHost::push(std::int64_t time_us, std::size_t place, What what) {
  const bool last = what == What::kCrash || what == What::kRestart;
  if (what == What::kWake) places_[place]->wake_us = time_us;
  events_.push({time_us,
                last ? std::numeric_limits<std::size_t>::max() : place,
                sequence_++,
                place,
                what,
                BusId::kOnboard,
                {},
                nullptr});
}

void LockstepHost::send(const Place& from, BusId id, std::string_view channel, std::span<const std::uint8_t> bytes) {
  const int robot = from.seat().robot_id;
  if (listener_) listener_(now_us_, id, robot, channel, bytes);
  Bus& bus = from.bus(id);
  const auto heard = bus.places.find(channel);
  if (heard == bus.places.end()) return;
  const auto shared = std::make_shared<const std::vector<std::uint8_t>>(bytes.begin(), bytes.end());
  const std::int64_t arrives_us = now_us_ + bus.delay_us + from.seat().work_us;
  for (const std::size_t place : heard->second) {
    constexpr std::array<std::int64_t, 1> kAtOnce = {0};
    const int receiver = places_[place]->seat().robot_id;
    const bool linked = bus.link && receiver != robot;
    for (const std::int64_t later_us : linked ? bus.link(robot, receiver, now_us_) : std::span(kAtOnce)) {
      events_.push(
          {arrives_us + later_us, place, sequence_++, place, What::kMessage, id, std::string(channel), shared});
    }
  }
}

void LockstepHost::handle(const Event& event) {
  Place& place = *places_[event.place];
  if (event.what == What::kCrash) return place.crash();
  if (event.what == What::kRestart) {
    place.restart();
    return push(now_us_, event.place, What::kWake);
  }
  if (place.node() == nullptr) return;
  if (event.what == What::kWake && event.time_us != place.wake_us) return;
  if (event.what == What::kMessage) place.hear(event.bus, event.channel, *event.bytes);
  const std::int64_t wake_us = place.step();
  if (event.what == What::kWake || wake_us != place.wake_us) push(wake_us, event.place, What::kWake);
}

}  // namespace swarm
