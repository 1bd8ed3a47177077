// The broadcast daemon's node among peers: whatever comes, the setpoints keep their rate, and what is flown neither
// jumps nor passes the limits; announcements and statuses go out, the former no faster than they may.
#include <memory>
#include <optional>

#include "lcmtypes/bus/crc32.h"
#include "planner_daemon/coordination/broadcast_node.h"
#include "tests/fuzz/fuzz_node.h"

namespace swarm::fuzz {
namespace {

using sogm_swarm::ack_t;
using sogm_swarm::announcement_t;

constexpr std::uint8_t kRosterIds[] = {0, 0, 0, 1, 0, 2};
constexpr std::int32_t kBoot = 7;
constexpr Duration kSetpointPeriod = 10ms, kStatusPeriod = 1s, kTwin = 2s;

class Bench : public NodeBench<Bench, BroadcastNode> {
 public:
  static BroadcastConfig config() {
    BroadcastConfig config;
    config.robot_id = kRobot;
    config.roster = {0, 1, 2};
    return config;
  }
  Bench(PromiseStore& store, Utime start) : NodeBench(config(), store, kBoot) {
    now = start;
    step();
  }

  using NodeBench::hear;
  void hear(const sogm_swarm::setpoint_t& setpoint) {
    last_setpoint_ = elapsed;
    const Eigen::Vector3d velocity(setpoint.velocity);
    // Candidates are looked at every few milliseconds, not everywhere.
    expect(velocity.cwiseAbs().maxCoeff() < 1.01 * config().limits.v_max_mps + 0.1, "no setpoint is too fast");
  }
  void hear(const sogm_swarm::broadcast_status_t&) { last_status_ = elapsed; }
  void hear(const announcement_t& message) {
    if (message.header.robot_id != kRobot) return;
    own = message;
    last_announcement_ = elapsed;
    ++announcements_;
  }

  void before() {
    if (node.motion()) state_ = node.motion()->at(now);
    forced_ = node.protocol().forced();
  }
  void after() {
    if (!node.motion()) return;
    const MotionState state = node.motion()->at(now);
    // Whoever was off course, or stands on the ground, goes on from where it is said to be.
    const auto is_at = [&](const auto& place) { return place && (state.position - *place).norm() < 1e-3; };
    const bool is_where_it_is = is_at(reported) || is_at(believed);
    if (state_ && !(node.protocol().forced() > forced_ && is_where_it_is)) expect_same(state, *state_);
    if (!moves_) last_setpoint_ = last_announcement_ = elapsed;
    moves_ = true;
  }
  void on_step_of_clock(Duration) {
    if (state_) expect_same(node.motion()->at(now), *state_);
    allow_pause();
  }
  // Between messages and steps, all that is due has been done.
  void check() {
    expect(elapsed - last_status_ <= kStatusPeriod, "statuses go out");
    if (!moves_) return;
    if (elapsed >= silent_until_) {
      expect(elapsed - std::max(last_setpoint_, silent_until_) <= kSetpointPeriod, "setpoints keep their rate");
    }
    expect(elapsed - last_announcement_ <= to_duration(config().rest_s) + 3ms, "announcements go out");
    const double most = to_seconds(elapsed) * config().swarm_rate_hz / 3;
    expect(announcements_ / 2 <= most + 3 * pauses_, "announcements keep below their rate");  // each on two buses
  }

  // One may take part of a period longer than usual, or come early.
  void allow_pause() {
    last_setpoint_ = last_announcement_ = last_status_ = elapsed;
    ++pauses_;
  }
  // A twin was heard, maybe.
  void allow_silence() { silent_until_ = elapsed + kTwin + kSetpointPeriod; }

  std::optional<announcement_t> own;        // newest
  std::optional<Eigen::Vector3d> reported;  // where the robot was said to be last,
  std::optional<Eigen::Vector3d> believed;  // and where so that it was believed

 private:
  static void expect_same(const MotionState& a, const MotionState& b) {
    expect((a.position - b.position).norm() < 1.1e-4 && (a.velocity - b.velocity).norm() < 1.1e-3,
           "what is flown does not jump");
  }

  std::optional<MotionState> state_;  // at `now`, before
  std::int32_t forced_ = 0;           // trajectories, before
  bool moves_ = false;
  int announcements_ = 0, pauses_ = 1;
  Duration last_setpoint_{}, last_announcement_{}, last_status_{}, silent_until_{};
};

struct Peer {
  Trajectory committed, pending;
  std::int8_t pending_state = announcement_t::kNone;
  std::int32_t seq = 1;
};

announcement_t announcement_of(FuzzInput& input, Bench& bench, int id, Peer* peer) {
  const Eigen::Vector3d at(id == 0 ? -3.0 : 3.0, 0, 1);
  const std::uint8_t what = input.byte();
  if (peer->committed.empty() || what % 8 == 0) peer->committed = trajectory(input, bench.now, at, ++peer->seq);
  if (what % 4 == 1) {
    const Utime start = bench.now + Bench::duration(input);
    peer->pending = trajectory(input, start, peer->committed.at(start).position, ++peer->seq);
    peer->pending_state = announcement_t::kAnnounced;
  } else if (what % 8 == 2) {
    peer->pending = {};
    peer->pending_state = announcement_t::kNone;
  } else if (what % 8 == 3 && !peer->pending.empty()) {
    peer->pending_state = announcement_t::kCommitted;
  }
  announcement_t message{};
  message.header = bench.header(input, id);
  message.radius = 0.2f;
  message.committed = peer->committed.to_wire();
  message.pending = peer->pending.to_wire();
  message.pending_state = peer->pending_state;
  message.pending_stamp = peer->pending.empty() ? 0 : to_us(bench.now) - input.byte() * 100;
  message.roster_crc = static_cast<std::int32_t>(crc32(kRosterIds));
  message.least_delay_us = what & 64 ? announcement_t::kUnknown : input.integer(-20'000, 20'000);
  message.num_acks = 3;
  message.acks.assign(3, {-1, 0, ack_t::kNone});
  if (!bench.own) return message;
  // About the robot itself.
  ack_t& ack = message.acks[Bench::kRobot];
  ack.peer_boot = bench.own->header.boot + (what & 128 ? input.byte() % 3 - 1 : 0);
  const std::uint8_t verdict = input.byte();
  if (bench.own->pending.seq != 0 && verdict % 4 != 0) {
    ack.judged_seq = bench.own->pending.seq;
    ack.verdict = verdict % 4 == 1 ? ack_t::kNack : ack_t::kAck;
  }
  if (verdict % 16 == 12) ack = {ack.peer_boot, input.byte(), ack_t::kGivenUp};
  if (verdict % 32 == 28) message.acks[2 - static_cast<std::size_t>(id)] = {1, input.byte(), ack_t::kGivenUp};
  return message;
}

void send_state(FuzzInput& input, Bench* bench) {
  sogm_swarm::robot_state_t state{};
  state.header = bench->header(input, Bench::kRobot);
  const Eigen::Vector3d at =
      bench->node.motion() ? bench->node.motion()->at(bench->now).position : Eigen::Vector3d::UnitZ();
  Eigen::Map<Eigen::Vector3d>(state.position) = at + (input.flag() ? place(input, 1.0) : Eigen::Vector3d::Zero());
  bench->reported = Eigen::Vector3d(state.position);
  const std::int64_t refused = bench->node.refused().total();
  bench->send(BusId::kOnboard, channel::kRobotState, state);
  if (bench->node.refused().total() == refused) bench->believed = bench->reported;
}

void send_candidate(FuzzInput& input, Bench* bench, std::int32_t seq) {
  sogm_swarm::candidate_t candidate{};
  const std::uint8_t what = input.byte();
  const Utime start = bench->now + Bench::duration(input);
  const MotionState from = bench->node.motion() ? bench->node.motion()->at(start) : MotionState{};
  const Eigen::Vector3d to = from.position + place(input, 2.0);
  const Duration piece(input.integer(10, 500) * 1000);
  const int pieces = input.integer(1, Trajectory::kMaxPieces);
  Trajectory planned = test::quintic_to(from, start, to, to_seconds(piece) * pieces, pieces, seq);
  for (int k = 1; k < pieces && what % 16 == 1; ++k) {  // not one quintic
    MotionState knot = planned.knot(k);
    knot.position += place(input, 0.5);
    knot.velocity = place(input, 2.0);
    planned.set_knot(k, knot);
  }
  candidate.header = bench->header(input, Bench::kRobot);
  candidate.header.utime = std::min(candidate.header.utime, to_us(start));
  candidate.urgent = what & 128 ? 1 : 0;
  candidate.trajectory = planned.to_wire();
  bench->send(BusId::kOnboard, channel::kCandidate, candidate);
}

void send_order(FuzzInput& input, Bench* bench) {
  sogm_swarm::order_t order{};
  order.header = bench->header(input, Bench::kRobot);
  order.order = static_cast<std::int16_t>(input.byte() % 7);
  order.height = order.order == sogm_swarm::order_t::kTakeOff ? input.real(0.1, 5) : 0.0;
  if (order.order == sogm_swarm::order_t::kWithout) order.other_id = static_cast<std::int16_t>(input.byte() % 4);
  bench->send(BusId::kOnboard, channel::kFlightOrder, order);
}

void send_vehicle(FuzzInput& input, Bench* bench) {
  sogm_swarm::vehicle_status_t vehicle{};
  vehicle.header = bench->header(input, Bench::kRobot);
  vehicle.armed = input.flag() ? 1 : 0;
  vehicle.obeys = static_cast<std::int16_t>(vehicle.armed != 0 && input.flag() ? 1 : 0);
  vehicle.place = static_cast<std::int16_t>(input.byte() % 3);
  vehicle.battery = input.flag() ? -1.0f : static_cast<float>(input.real(0, 1));
  bench->send(BusId::kOnboard, channel::kVehicleStatus, vehicle);
}

// A twin, or an echo of what it said itself.
void send_own(FuzzInput& input, Bench* bench) {
  announcement_t message = *bench->own;
  if (input.flag()) message.header = bench->header(input, Bench::kRobot);
  const bool onboard = input.flag();
  bench->send(onboard ? BusId::kOnboard : BusId::kSwarm, onboard ? channel::kOwnTrajectory : channel::kAnnouncement,
              message);
  bench->allow_silence();
}

}  // namespace

void try_input(FuzzInput input) {
  MemoryPromiseStore store;
  auto bench = std::make_unique<Bench>(store, input.flag() ? to_utime(1'700'000'000'000'000) : Utime(10s));
  Peer peers[2];
  std::int32_t seq = 100;
  play(input, 16, 30s, bench, [&](int number) {
    if (number == 0) {
      bench->deliver_anything(input);
      bench->allow_silence();
    } else if (number == 2) {  // it crashes, and starts again
      const Utime now = bench->now;
      bench = std::make_unique<Bench>(store, now + 100ms);
    } else if (number == 3) {
      if (bench->own) send_own(input, bench.get());
    } else if (number <= 5) {
      send_state(input, bench.get());
    } else if (number <= 8) {
      send_candidate(input, bench.get(), ++seq);
    } else if (number <= 12) {
      const int place_of_peer = input.flag() ? 1 : 0;
      const announcement_t message = announcement_of(input, *bench, 2 * place_of_peer, &peers[place_of_peer]);
      bench->send(BusId::kSwarm, channel::kAnnouncement, message);
    } else if (number == 13) {
      send_order(input, bench.get());
    } else if (number == 14) {
      send_vehicle(input, bench.get());
    }
    return number <= 14;
  });
}

}  // namespace swarm::fuzz
