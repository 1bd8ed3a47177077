// The planner daemon's node: whatever comes, statuses go out, and what it proposes leaves the robot's own motion,
// within the limits and soon enough for the broadcaster.
#include <optional>

#include "map_daemon/sogm_codec.h"
#include "planner_daemon/planner_node.h"
#include "planner_daemon/trajectory/mission.h"
#include "tests/fuzz/fuzz_node.h"

namespace swarm::fuzz {
namespace {

using sogm_swarm::announcement_t;
using sogm_swarm::candidate_t;

class Bench : public NodeBench<Bench, PlannerNode> {
 public:
  static PlannerNodeConfig config() {
    PlannerNodeConfig config;
    config.robot_id = kRobot;
    config.planner.limits.space_min = {-8, -8, 0.2};
    config.planner.limits.space_max = {8, 8, 3.8};
    config.planner.search.max_expansions = 200;
    return config;
  }
  Bench() : NodeBench(config(), 1, nullptr, false) { step(); }

  using NodeBench::hear;
  void hear(const sogm_swarm::planner_status_t&) { last_status_ = elapsed; }
  void hear(const candidate_t& message) {
    const Trajectory planned = Trajectory::from_wire(message.trajectory);
    const Utime start = planned.start_utime();
    expect(start > now && start <= now + kMaxAhead && planned.end_utime() <= now + kMaxMotion, "a plan is in time");
    const MotionState own = node.newest_request().own.at(start), first = planned.knot(0);
    const double digits = 1e-6 * (1.0 + own.position.cwiseAbs().maxCoeff());  // of a float
    expect((own.position - first.position).norm() < 1e-4 + digits && (own.velocity - first.velocity).norm() < 1e-3 &&
               (own.acceleration - first.acceleration).norm() < 1e-2,
           "a plan leaves the own motion");
    candidate_ = planned;
    const PlannerConfig& planner = config().planner;
    for (Utime t = start; t < planned.end_utime() && is_tame_; t += 10ms) {
      const MotionState state = planned.at(t);
      expect(state.velocity.cwiseAbs().maxCoeff() <= 1.01 * planner.limits.v_max_mps &&
                 state.acceleration.cwiseAbs().maxCoeff() <= 1.01 * planner.limits.a_max_mps2,
             "a plan keeps to the limits");
    }
  }
  void on_step_of_clock(Duration step) {
    last_status_ = elapsed;
    for (Trajectory* known : {&own_.committed, &own_.next, &pending_, &candidate_}) known->shift(step);
  }
  void check() { expect(elapsed - last_status_ <= 1s, "statuses go out"); }

  void anything(FuzzInput& input) {
    is_tame_ = false;  // it may have been a motion beyond all limits
    deliver_anything(input);
  }
  // What its broadcaster says: it hovers, and commits what was proposed or has it wait.
  void send_own(FuzzInput& input) {
    const std::uint8_t what = input.byte();
    if (!own_.next.empty() && own_.next.start_utime() <= now) own_ = {own_.next, {}};
    if (own_.committed.empty() || what % 32 == 0) {
      own_ = {Trajectory::hover(++number_, now, Eigen::Vector3d(0, 0, 1) + place(input, what % 64 == 0 ? 10.0 : 2.0)),
              {}};
      pending_ = {};
    }
    if (!candidate_.empty() && candidate_.start_utime() > now && what % 2 == 1 && own_.next.empty()) {
      Trajectory taken = candidate_;
      taken.set_seq(++number_);
      (what % 4 == 1 ? own_.next : pending_) = taken;
      if (what % 4 == 1) pending_ = {};
    } else if (what % 8 == 2) {
      pending_ = {};
    }
    announcement_t message = announcement(input, kRobot, own_, pending_);
    if (what % 64 == 3) message.forced_seq = own_.next.seq();
    send(BusId::kOnboard, channel::kOwnTrajectory, message);
  }
  void send_peer(FuzzInput& input) {
    const int id = input.byte() % 6;
    const Eigen::Vector3d at = Eigen::Vector3d(0, 0, 1) + place(input, 4.0);
    Motion motion{trajectory(input, now - duration(input), at, ++number_), {}};
    Trajectory pending;
    const std::uint8_t what = input.byte();
    if (what % 4 == 1) pending = trajectory(input, now + duration(input), at, ++number_);
    if (what % 4 == 2) motion.next = trajectory(input, now + duration(input), at, ++number_);
    send(BusId::kOnboard, channel::kPeerTrajectory, announcement(input, id, motion, pending));
  }
  void send_goal(FuzzInput& input) {
    Mission mission;
    for (int count = 1 + input.byte() % 3; count > 0; --count) {
      const std::uint8_t what = input.byte();
      Waypoint waypoint;
      waypoint.position = Eigen::Vector3d(0, 0, 1) + place(input, what % 16 == 0 ? 1e5 - 1 : 6.0);
      if (what & 32) waypoint.speed_mps = input.real(0.05, 100);
      if (what & 64) waypoint.tolerance_m = input.real(0, 10);
      if (what & 128) waypoint.wait = duration(input);
      mission.push_back(waypoint);
    }
    sogm_swarm::goal_t goal = to_goal(mission);
    goal.header = header(input, kRobot);
    send(BusId::kOnboard, channel::kGoal, goal);
  }
  void send_map(FuzzInput& input) {
    GridGeometry grid;
    const std::uint8_t what = input.byte();
    grid.resolution_m = what & 1 ? 0.2 : what & 2 ? 0.1 : input.real(0.05, 0.5);
    const int edge = what & 4 ? 40 : input.integer(1, 48);
    grid.size = {edge, what & 8 ? edge : input.integer(1, 48), what & 16 ? 20 : input.integer(1, 70)};
    const Eigen::Vector3d at = Eigen::Vector3d(0, 0, 1) + (what & 32 ? Eigen::Vector3d(0, 0, 0) : place(input, 3.0));
    grid.origin = lattice_voxel(at, grid.resolution_m) - grid.size / 2;
    map_.reset(grid, what & 64 ? 20 : input.integer(1, 24), now - Duration(input.byte() * 1000),
               what & 128 ? 100ms : Duration(input.integer(1, 400) * 1000));
    for (int boxes = input.byte() % 8; boxes > 0; --boxes) occupy(input);
    const auto parts = encoder_.encode(map_, header(input, kRobot));
    for (const sogm_swarm::sogm_t& part : std::vector(parts.begin(), parts.end()))
      send(BusId::kOnboard, channel::kSogm, part);
  }

 private:
  announcement_t announcement(FuzzInput& input, int id, const Motion& motion, const Trajectory& pending) {
    announcement_t message{};
    message.header = header(input, id);
    message.radius = 0.2f;
    message.committed = motion.committed.to_wire();
    const Trajectory& second = pending.empty() ? motion.next : pending;
    message.pending = second.to_wire();
    message.pending_state = second.empty()    ? announcement_t::kNone
                            : pending.empty() ? announcement_t::kCommitted
                                              : announcement_t::kAnnounced;
    message.pending_stamp = to_us(now) - 1000 * input.byte();
    return message;
  }
  // A box of voxels, the same in all frames or moving.
  void occupy(FuzzInput& input) {
    const GridGeometry& grid = map_.geometry;
    const auto within = [&](int axis) { return input.byte() % grid.size[axis]; };
    const Eigen::Vector2i first(within(0), within(1));
    const int width = 1 + input.byte() % 12, moves = input.byte() % 3, z = within(2), height = 1 + input.byte() % 64;
    for (int frame = 0; frame < map_.num_frames; ++frame) {
      const int x0 = first.x() + moves * frame;
      for (int x = x0; x < std::min(x0 + width, grid.size.x()); ++x) {
        for (int y = first.y(); y < std::min(first.y() + width, grid.size.y()); ++y) {
          set_run(z, z + height - 1, grid.size.z(), map_.column(frame, x, y));
        }
      }
    }
  }

  Sogm map_;
  SogmEncoder encoder_;
  Motion own_;
  Trajectory pending_, candidate_;
  bool is_tame_ = true;
  std::int32_t number_ = 0;
  Duration last_status_{};
};

}  // namespace

void try_input(FuzzInput input) {
  constexpr int kMostMessages = 64;  // plans take their time
  Bench bench;
  int messages = 0;
  play(input, 16, 10s, &bench, [&](int number) {
    if (++messages == kMostMessages) (void)input.rest();
    if (number == 0) {
      bench.anything(input);
    } else if (number <= 4) {
      bench.send_own(input);
    } else if (number <= 6) {
      bench.send_peer(input);
    } else if (number <= 8) {
      bench.send_goal(input);
    } else if (number <= 12) {
      bench.send_map(input);
    } else if (number == 13) {
      bench.send(BusId::kOnboard, channel::kFlightStatus, flight_status(input, bench.header(input, Bench::kRobot)));
    }
    return number <= 13;
  });
}

}  // namespace swarm::fuzz
