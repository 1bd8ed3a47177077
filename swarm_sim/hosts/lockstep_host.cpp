#include "swarm_sim/hosts/lockstep_host.h"

#include <array>
#include <limits>
#include <tuple>

#include "lcmtypes/bus/node_clock.h"

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
    clock_ = NodeClock(read());
    node_ = make_node_();
  }
  void step_clock(Duration by) { seat_.clock_offset += by; }
  void hear(BusId id, std::string_view channel, std::span<const std::uint8_t> bytes) {
    watch_clock();
    node_->on_message(time(), id, channel, bytes, *this);
  }
  Utime step() {
    watch_clock();
    const Utime time = this->time();
    return host_.now_ + (node_->step(time, *this) - time);
  }
  void publish_bytes(BusId id, std::string_view channel, std::span<const std::uint8_t> bytes) override {
    host_.send(*this, id, channel, bytes);
  }

  Utime wake{};  // the wake-up in force; earlier entries in the queue are void

 private:
  ClockReading read() const { return {host_.now_.time_since_epoch(), host_.now_ + seat_.clock_offset}; }
  Utime time() { return clock_.read(read()); }
  void watch_clock() {
    const Utime time = this->time();
    (void)clock_.offer_step([&](Duration step) { return node_->on_clock_step(time, step); });
  }

  Seat seat_;
  LockstepHost& host_;
  NodeFactory make_node_;
  NodeClock clock_{read()};
  std::unique_ptr<Node> node_;
};

bool LockstepHost::Event::operator>(const Event& other) const {
  return std::tie(time, order, sequence) > std::tie(other.time, other.order, other.sequence);
}

LockstepHost::LockstepHost(Utime begin) : now_(begin) {}
LockstepHost::~LockstepHost() = default;

void LockstepHost::add_bus(const std::string& name, Duration delay, Link link) {
  buses_[name] = {delay, std::move(link), {}};
}

std::size_t LockstepHost::add(const Seat& seat, NodeFactory make_node) {
  const std::size_t number = places_.size();
  const Place& place = *places_.emplace_back(std::make_unique<Place>(*this, seat, std::move(make_node)));
  for (const Subscription& subscription : place.node()->subscriptions())
    place.bus(subscription.bus).places[subscription.channel].push_back(number);
  push(now_, number, What::kWake);
  return number;
}

void LockstepHost::crash(std::size_t seat, Utime at, Utime back) {
  push(at, seat, What::kCrash);
  push(back, seat, What::kRestart);
}

void LockstepHost::step_clock(std::size_t seat, Utime at, Duration by) {
  push(at, seat, What::kClock, by);
}

void LockstepHost::run() {
  stopped_ = false;
  while (!events_.empty() && (!stopped_ || events_.top().time == now_)) {
    const Event event = events_.top();
    events_.pop();
    now_ = event.time;
    handle(event);
  }
}

void LockstepHost::push(Utime time, std::size_t place, What what, Duration by) {
  const bool last = what != What::kMessage && what != What::kWake;
  if (what == What::kWake) places_[place]->wake = time;
  events_.push({time,
                last ? std::numeric_limits<std::size_t>::max() : place,
                sequence_++,
                place,
                what,
                BusId::kOnboard,
                {},
                nullptr,
                by});
}

void LockstepHost::send(const Place& from, BusId id, std::string_view channel, std::span<const std::uint8_t> bytes) {
  const int robot = from.seat().robot_id;
  if (listener_) listener_(now_, id, robot, channel, bytes);
  Bus& bus = from.bus(id);
  const auto heard = bus.places.find(channel);
  if (heard == bus.places.end()) return;
  const auto shared = std::make_shared<const std::vector<std::uint8_t>>(bytes.begin(), bytes.end());
  const Utime arrives = now_ + bus.delay + from.seat().work;
  for (const std::size_t place : heard->second) {
    constexpr std::array<Duration, 1> kAtOnce = {0us};
    const int receiver = places_[place]->seat().robot_id;
    const bool linked = bus.link && receiver != robot;
    for (const Duration later : linked ? bus.link(robot, receiver, now_) : std::span(kAtOnce)) {
      events_.push({arrives + later, place, sequence_++, place, What::kMessage, id, std::string(channel), shared});
    }
  }
}

void LockstepHost::handle(const Event& event) {
  Place& place = *places_[event.place];
  if (event.what == What::kCrash) return place.crash();
  if (event.what == What::kRestart) {
    place.restart();
    return push(now_, event.place, What::kWake);
  }
  if (event.what == What::kClock) place.step_clock(event.by);
  if (place.node() == nullptr) return;
  if (event.what == What::kWake && event.time != place.wake) return;
  if (event.what == What::kMessage) place.hear(event.bus, event.channel, *event.bytes);
  const Utime wake = place.step();
  if (event.what == What::kWake || wake != place.wake) push(wake, event.place, What::kWake);
}

}  // namespace swarm
