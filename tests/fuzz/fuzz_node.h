// Nodes in simulated time, driven by an input as hosts drive them: messages of any bytes, valid ones, time, and steps
// of the wall clock. What every node must keep is checked here.
#pragma once

#include <spdlog/spdlog.h>

#include <algorithm>
#include <map>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/packed_announcement.h"
#include "planner_daemon/trajectory/trajectory.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/quintic_to.h"

namespace swarm::fuzz {

// What nodes log of bad messages is of no use here, and takes most of the time.
inline const bool kIsQuiet = (spdlog::set_level(spdlog::level::off), true);

// A derived class defines hear(const T& message) for what it wants to look at, and calls step() when it is made.
template <class Derived, class NodeType>
class NodeBench : public Outbox {
 public:
  static constexpr int kRobot = 1;
  static constexpr Duration kMaxStep = 100s;  // of the wall clock

  template <class... Arguments>
  explicit NodeBench(Arguments&&... arguments) : node(std::forward<Arguments>(arguments)...) {}

  void publish_bytes(BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes) override {
    expect(std::ranges::any_of(kChannels, [&](const Channel& c) { return c.bus == bus && c.name == channel; }),
           "a node speaks on channels there are");
    [&]<class... T>(const std::tuple<T...>*) {
      (void)((is_carried_by<T>(channel) && (look_at<T>(bus, channel, bytes), true)) || ...);
    }(static_cast<AllMessages*>(nullptr));
  }

  void step() {
    if (wall_ahead != 0us && node.on_clock_step(now, wall_ahead)) {
      now += wall_ahead;
      static_cast<Derived*>(this)->on_step_of_clock(wall_ahead);
      wall_ahead = {};
    }
    static_cast<Derived*>(this)->before();
    wake = node.step(now, *this);
    expect(wake > now, "a node wakes in the future");
    static_cast<Derived*>(this)->after();
  }
  void deliver(BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes) {
    // In memory of its own, so that nobody reads past its end or keeps it.
    const Bytes copy(bytes.begin(), bytes.end());
    static_cast<Derived*>(this)->before();
    node.on_message(now, bus, channel, copy, *this);
    static_cast<Derived*>(this)->after();
    step();
  }
  template <class T>
  void send(BusId bus, std::string_view channel, const T& message) {
    if constexpr (std::is_same_v<T, sogm_swarm::announcement_t>) {
      auto copy = message;
      if (bus == BusId::kSwarm) return encode_packed(&copy, &last_), deliver(bus, channel, last_);
    }
    encode(message, &last_);
    deliver(bus, channel, last_);
  }
  // Lets time pass; the node is called when it wants to be.
  void run_for(Duration duration) {
    const Utime until = now + duration;
    int calls = 0;
    while (wake <= until) {
      elapsed += wake - now;
      now = wake;
      step();
      const bool has_jumped = now > until || now + kMaxStep / 2 < until;
      if (has_jumped) return;  // the clock was stepped: the rest of the time does not matter
      expect(++calls < 100'000, "a node does not spin");
    }
    elapsed += until - now;
    now = until;
  }

  // Any bytes on one of its channels.
  void deliver_anything(FuzzInput& input) {
    const std::vector<Subscription> subscriptions = node.subscriptions();
    const Subscription& to = subscriptions[input.byte() % subscriptions.size()];
    deliver(to.bus, to.channel, message_bytes(input, to.channel));
  }
  // The wall clock is set, also before the last setting was taken; never to before the epoch.
  void set_clock(FuzzInput& input) {
    const Duration by = input.flag() ? Duration(input.integer(-100'000, 100'000))
                                     : Duration(input.integer(-kMaxStep.count(), kMaxStep.count()));
    wall_ahead = now + by < Utime(1s) ? Duration() : by;
    if (wall_ahead == 0us) node.on_clock_step(now, wall_ahead);
    step();
  }
  // From a few microseconds to seconds.
  static Duration duration(FuzzInput& input) {
    const int scale = input.byte() % 4;
    return Duration((input.byte() + 1) * (scale == 0 ? 10 : scale == 1 ? 200 : scale == 2 ? 2'000 : 10'000));
  }
  // A header as another would send it: in order, or out of it.
  sogm_swarm::header_t header(FuzzInput& input, int robot_id) {
    sogm_swarm::header_t header{};
    header.schema_version = sogm_swarm::header_t::kSchemaVersion;
    header.robot_id = static_cast<std::int16_t>(robot_id);
    const std::uint8_t order = input.byte();
    header.boot = 1 + order / 64;
    header.seq = order % 16 == 0 ? 0 : ++seq_;
    header.utime = std::max<std::int64_t>(to_us(now) - (order % 16 == 1 ? 1000 * input.integer(-300, 1'500) : 0), 0);
    return header;
  }

  // Defaults for what derived classes may look at.
  template <class T>
  void hear(const T&) {}
  void on_step_of_clock(Duration) {}
  void before() {}  // a message or a step of the node
  void after() {}

  Utime now = to_utime(1'700'000'000'000'000), wake{};
  Duration elapsed{};     // by no clock that anybody sets
  Duration wall_ahead{};  // the node is asked until it agrees
  NodeType node;

 private:
  template <class T>
  void look_at(BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes) {
    T message;
    expect(decode(bytes, &message) == Refusal::kNone,
           std::string("what a node says is valid: ") + std::string(channel));
    if (channel != channel::kPeerTrajectory && channel != channel::kSogm) {
      expect(message.header.robot_id == kRobot, "it speaks for its robot");
      auto& newest = newest_[{bus, std::string(channel)}];
      const std::pair order(message.header.boot, message.header.seq);
      expect(order > newest, "numbers grow");
      newest = order;
    }
    if constexpr (std::is_same_v<T, sogm_swarm::packed_announcement_t>) {
      sogm_swarm::announcement_t unpacked;
      expect(unpack(message, &unpacked) == Refusal::kNone, "what a node packs is valid");
      static_cast<Derived*>(this)->hear(unpacked);
    } else {
      static_cast<Derived*>(this)->hear(message);
    }
  }

  Bytes last_;
  std::int64_t seq_ = 0;
  std::map<std::pair<BusId, std::string>, std::pair<std::int32_t, std::int64_t>> newest_;
};

// Plays an input to a node, for `longest` at most: number 1 of so many `choices` sets the clock, act(number) does the
// target's own, and where it returns false time passes. Whatever was done, the node is looked at.
template <class BenchPointer, class Act>
void play(FuzzInput& input, int choices, Duration longest, const BenchPointer& bench, const Act& act) {
  for (Duration total{}; !input.empty() && total < longest;) {
    const int number = input.byte() % choices;
    if (number == 1) {
      bench->set_clock(input);
    } else if (!act(number)) {
      const Duration passes = bench->duration(input);
      bench->run_for(passes);
      total += passes;
    }
    bench->check();
  }
}

inline Eigen::Vector3d place(FuzzInput& input, double reach_m) {
  const double x = input.real(-reach_m, reach_m), y = input.real(-reach_m, reach_m), z = input.real(-reach_m, reach_m);
  return {x, y, z};
}

// Of any state: where it is in its flight.
inline sogm_swarm::flight_status_t flight_status(FuzzInput& input, const sogm_swarm::header_t& header) {
  sogm_swarm::flight_status_t status{};
  status.header = header;
  status.state = static_cast<std::int16_t>(input.byte() % 7);
  status.cause = static_cast<std::int16_t>(input.byte() % 6);
  status.led_to = static_cast<std::int16_t>(input.byte() % 3);
  status.order_boot = -1;
  Eigen::Map<Eigen::Vector3d>(status.destination) = Eigen::Vector3d(0, 0, 1) + place(input, 6.0);
  status.climb = input.real(0, 3);
  return status;
}

// From rest somewhere, or from the state of another trajectory.
inline Trajectory trajectory(FuzzInput& input, Utime start, const Eigen::Vector3d& from, std::int32_t seq) {
  const Eigen::Vector3d to = from + place(input, 3.0);
  const Duration piece(input.integer(10, 600) * 1000);
  const int pieces = input.integer(1, Trajectory::kMaxPieces);
  if (input.byte() % 4 == 0) return Trajectory::hover(seq, start, from);
  MotionState state;
  state.position = from;
  return test::quintic_to(state, start, to, to_seconds(piece) * pieces, pieces, seq);
}

}  // namespace swarm::fuzz
