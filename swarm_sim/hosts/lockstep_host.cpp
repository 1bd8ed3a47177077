#include "swarm_sim/hosts/lockstep_host.h"

#include <algorithm>
#include <array>
#include <limits>
#include <set>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "lcmtypes/bus/node_clock.h"
#include "swarm_sim/results/air_traffic.h"

namespace swarm {
namespace {

constexpr std::size_t kLast = std::numeric_limits<std::size_t>::max();  // behind all places

}  // namespace

// A node, its buses and its wake-ups. What the node does while others run beside it is noted, and done afterwards.
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
  void take(const Event& event) {
    if (node_ == nullptr || (event.what == What::kWake && event.time != wake_)) return;
    watch_clock();
    if (event.what == What::kMessage) {
      node_->on_message(time(), event.bus, event.channel, *event.bytes, *this);
      watch_clock();
    }
    const Utime time = this->time(), wake = host_.now_ + (node_->step(time, *this) - time);
    if (event.what != What::kWake && wake == wake_) return;
    wake_ = wake;
    deeds_.push_back({.what = Deed::kWake, .wake = wake});
  }
  void wake_at(Utime wake) {
    wake_ = wake;
    host_.push(wake, number_, What::kWake);
  }
  // In the order in which they were done.
  void do_deeds() {
    for (Deed& deed : deeds_) {
      if (deed.what == Deed::kWake) host_.push(deed.wake, number_, What::kWake);
      if (deed.what == Deed::kSend) host_.send(*this, deed.bus, std::move(deed.channel), std::move(deed.bytes));
      if (deed.what == Deed::kListen) host_.listen(number_, &bus(deed.bus), deed.channel, deed.listens);
    }
    deeds_.clear();
  }
  void publish_bytes(BusId id, std::string_view channel, std::span<const std::uint8_t> bytes) override {
    deeds_.push_back({.what = Deed::kSend,
                      .bus = id,
                      .channel = std::string(channel),
                      .bytes = std::make_shared<const std::vector<std::uint8_t>>(bytes.begin(), bytes.end())});
  }
  void listen(BusId id, std::string_view channel, bool listens) override {
    const std::pair key(id, std::string(channel));
    listens ? void(listens_to_.insert(key)) : void(listens_to_.erase(key));
    deeds_.push_back({.what = Deed::kListen, .bus = id, .channel = key.second, .listens = listens});
  }

 private:
  struct Deed {
    enum { kWake, kSend, kListen } what;
    Utime wake{};
    BusId bus = BusId::kOnboard;
    std::string channel{};
    Bytes bytes{};
    bool listens = false;
  };

  ClockReading read() const { return {host_.now_.time_since_epoch(), host_.now_ + seat_.clock_offset}; }
  Utime time() { return clock_.read(read()); }
  void watch_clock() {
    const Utime time = this->time();
    (void)clock_.offer_step([&](Duration step) { return node_->on_clock_step(time, step); });
  }

  std::size_t number_;
  Seat seat_;
  LockstepHost& host_;
  Utime wake_{};  // the wake-up in force; earlier entries in the queue are void
  std::vector<Deed> deeds_;
  std::set<std::pair<BusId, std::string>> listens_to_;  // besides the node's subscriptions
  NodeFactory make_node_;
  NodeClock clock_{read()};
  std::unique_ptr<Node> node_;
};

bool LockstepHost::Event::operator>(const Event& other) const {
  return std::tie(time, order, sequence) > std::tie(other.time, other.order, other.sequence);
}

LockstepHost::LockstepHost(Utime begin, int threads) : now_(begin), workers_(threads) {}
LockstepHost::~LockstepHost() = default;

void LockstepHost::add_bus(const std::string& name, Duration delay, Link link, RadioChannel* radio) {
  if (delay <= 0us) throw std::invalid_argument("bus " + name + ": messages must take longer than nothing");
  buses_[name] = {.delay = delay, .link = std::move(link), .radio = radio};
}

std::size_t LockstepHost::add(const Seat& seat, NodeFactory make_node) {
  const std::size_t number = places_.size();
  const Place& place = *places_.emplace_back(std::make_unique<Place>(*this, number, seat, std::move(make_node)));
  for (const Subscription& subscription : place.node()->subscriptions())
    listen(number, &place.bus(subscription.bus), subscription.channel, true);
  places_.back()->wake_at(now_);
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
    now_ = events_.top().time;
    const auto take = [this] {
      Event event = events_.top();
      events_.pop();
      return event;
    };
    if (events_.top().order == kLast) {
      handle_last(take());
      continue;
    }
    batch_.clear();
    while (!events_.empty() && events_.top().time == now_ && events_.top().order != kLast) batch_.push_back(take());
    handle_batch();
  }
}

void LockstepHost::push(Utime time, std::size_t place, What what, Duration by) {
  const bool is_last = what != What::kMessage && what != What::kWake;
  events_.push({time, is_last ? kLast : place, sequence_++, place, what, BusId::kOnboard, {}, nullptr, by});
}

void LockstepHost::send(const Place& from, BusId id, std::string channel, Bytes bytes) {
  const int robot = from.seat().robot_id;
  if (listener_) listener_(now_, id, robot, channel, *bytes);
  Bus& bus = from.bus(id);
  if (!bus.places.contains(channel)) return;
  const std::size_t size = datagram_bytes(channel, bytes->size());
  Message message = {robot, id, std::move(channel), std::move(bytes), bus.delay + from.seat().work};
  if (bus.radio == nullptr) return deliver(bus, message, Whose::kAll);
  deliver(bus, message, Whose::kOwn);
  bus.radio->send(now_, robot, size,
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
  events_.push({.time = due, .order = kLast, .sequence = sequence_++, .place = 0, .what = What::kRadio, .air = air});
}

void LockstepHost::handle_last(const Event& event) {
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
    return place.wake_at(now_);
  }
  place.step_clock(event.by);
  place.take(event);
  place.do_deeds();
}

void LockstepHost::handle_batch() {
  groups_.clear();
  for (std::size_t i = 0; i < batch_.size(); ++i) {
    const auto seat_of = [&](std::size_t at) -> const Seat& { return places_[batch_[at].place]->seat(); };
    const bool is_alone = seat_of(i).is_alone;
    const bool is_new =
        groups_.empty() || is_alone || groups_.back().is_alone || seat_of(i).robot_id != seat_of(i - 1).robot_id;
    if (is_new) groups_.push_back({i, i, is_alone});
    groups_.back().end = i + 1;
  }
  for (std::size_t first = 0; first < groups_.size();) {
    std::size_t end = first + 1;
    while (!groups_[first].is_alone && end < groups_.size() && !groups_[end].is_alone) ++end;
    workers_.for_each(end - first, [&](std::size_t k) {
      const Group& group = groups_[first + k];
      for (std::size_t i = group.begin; i < group.end; ++i) places_[batch_[i].place]->take(batch_[i]);
    });
    for (std::size_t i = groups_[first].begin; i < groups_[end - 1].end; ++i) places_[batch_[i].place]->do_deeds();
    first = end;
  }
}

}  // namespace swarm
