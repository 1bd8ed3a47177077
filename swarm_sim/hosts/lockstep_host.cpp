#include "swarm_sim/hosts/lockstep_host.h"

#include <algorithm>
#include <array>
#include <limits>
#include <set>
#include <tuple>
#include <utility>

#include "lcmtypes/bus/node_clock.h"
#include "swarm_sim/results/air_traffic.h"

namespace swarm {

// A node, its buses and its wake-ups.
class LockstepHost::Place : public Outbox {
 public:
  Place(LockstepHost& host, std::size_t number, const Seat& seat, NodeFactory make_node)
      : number_(number), seat_(seat), host_(host), make_node_(std::move(make_node)) {
    restart();
  }

  const Seat& seat() const { return seat_; }
  Bus& bus(BusId id) const { return host_.buses_.at(id == BusId::kSwarm ? seat_.swarm : seat_.onboard); }
  // Null: it has crashed.
  const Node* node() const { return node_.get(); }

  void crash() {
    node_.reset();
    for (const auto& [id, channel] : std::exchange(listens_to_, {})) host_.listen(number_, &bus(id), channel, false);
  }
  void restart() {
    crash();
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
  void listen(BusId id, std::string_view channel, bool listens) override {
    const std::pair key(id, std::string(channel));
    listens ? void(listens_to_.insert(key)) : void(listens_to_.erase(key));
    host_.listen(number_, &bus(id), key.second, listens);
  }

  Utime wake{};  // the wake-up in force; earlier entries in the queue are void

 private:
  ClockReading read() const { return {host_.now_.time_since_epoch(), host_.now_ + seat_.clock_offset}; }
  Utime time() { return clock_.read(read()); }
  void watch_clock() {
    const Utime time = this->time();
    (void)clock_.offer_step([&](Duration step) { return node_->on_clock_step(time, step); });
  }

  std::size_t number_;
  Seat seat_;
  LockstepHost& host_;
  std::set<std::pair<BusId, std::string>> listens_to_;  // besides the node's subscriptions
  NodeFactory make_node_;
  NodeClock clock_{read()};
  std::unique_ptr<Node> node_;
};

bool LockstepHost::Event::operator>(const Event& other) const {
  return std::tie(time, order, sequence) > std::tie(other.time, other.order, other.sequence);
}

LockstepHost::LockstepHost(Utime begin) : now_(begin) {}
LockstepHost::~LockstepHost() = default;

void LockstepHost::add_bus(const std::string& name, Duration delay, Link link, RadioChannel* radio) {
  buses_[name] = {.delay = delay, .link = std::move(link), .radio = radio};
}

std::size_t LockstepHost::add(const Seat& seat, NodeFactory make_node) {
  const std::size_t number = places_.size();
  const Place& place = *places_.emplace_back(std::make_unique<Place>(*this, number, seat, std::move(make_node)));
  for (const Subscription& subscription : place.node()->subscriptions())
    listen(number, &place.bus(subscription.bus), subscription.channel, true);
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
  if (!bus.places.contains(channel)) return;
  Message message = {robot, id, std::string(channel),
                     std::make_shared<const std::vector<std::uint8_t>>(bytes.begin(), bytes.end()),
                     bus.delay + from.seat().work};
  if (bus.radio == nullptr) return deliver(bus, message, Whose::kAll);
  deliver(bus, message, Whose::kOwn);
  bus.radio->send(now_, robot, datagram_bytes(channel, bytes.size()),
                  [this, &bus, message = std::move(message)] { deliver(bus, message, Whose::kOthers); });
  wake_radio(&bus);
}

void LockstepHost::listen(std::size_t place, Bus* bus, const std::string& channel, bool listens) {
  std::vector<std::size_t>& places = bus->places[channel];
  const auto found = std::ranges::lower_bound(places, place);
  const bool is_there = found != places.end() && *found == place;
  if (listens && !is_there) places.insert(found, place);
  if (!listens && is_there) places.erase(found);
}

void LockstepHost::deliver(const Bus& bus, const Message& message, Whose whose) {
  for (const std::size_t place : bus.places.find(message.channel)->second) {
    constexpr std::array<Duration, 1> kAtOnce = {0us};
    const int receiver = places_[place]->seat().robot_id;
    const bool is_own = receiver == message.robot_id;
    if (whose != Whose::kAll && is_own != (whose == Whose::kOwn)) continue;
    const bool linked = bus.link && !is_own;
    for (const Duration later : linked ? bus.link(message.robot_id, receiver, now_) : std::span(kAtOnce)) {
      events_.push({now_ + message.takes + later, place, sequence_++, place, What::kMessage, message.bus,
                    message.channel, message.bytes});
    }
  }
}

// Behind all else of the moment, as the crashes are.
void LockstepHost::wake_radio(Bus* air) {
  const Utime due = air->radio->due();
  if (due >= air->radio_wake) return;
  air->radio_wake = due;
  events_.push({.time = due,
                .order = std::numeric_limits<std::size_t>::max(),
                .sequence = sequence_++,
                .place = 0,
                .what = What::kRadio,
                .air = air});
}

void LockstepHost::handle(const Event& event) {
  if (event.what == What::kRadio) {
    if (event.time != event.air->radio_wake) return;
    event.air->radio_wake = kNever;
    event.air->radio->advance(now_);
    return wake_radio(event.air);
  }
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
